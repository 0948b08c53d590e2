"""Preparation of frames: preprocessing, predicted motion, and photometric adaptation of learned colours."""

from typing import NamedTuple

from uavbench.tracker.protocol import Image, ImageError, StampOrder
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import Motion
from uavbench.tracker.robust.preprocessing.denoising import smoothed
from uavbench.tracker.robust.preprocessing.gain_offset import ContrastStretch, brightness_ratio, compensated
from uavbench.tracker.robust.relocalization.ranking import Likely
from uavbench.tracker.robust.track_state import TrackState
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Array

ROWS_APART = 16
"""Stride of the rows of a frame that are compared with the previous frame."""


class Photometry(NamedTuple):
    """State that depends on illumination and exposure: learned appearance of the edges, contrast stretch of images.

    ok_rows: of the last image that was ok, with which others are compared.
    """

    appearance: Array
    stretch: ContrastStretch
    ok_rows: Image | None


class Frame(NamedTuple):
    """An image before and after preprocessing, and the predicted motion.

    dt_s: time since the last frame that was ok; step_s: time since the last frame; extrapolated_s: part of dt_s over
    which the prediction is the motion model's extrapolation; before: the photometry that this frame found; likely: the
    predictions under all hypotheses; follows_hypotheses: whether these are of the frame before.
    """

    raw: Image
    image: Image
    predicted: Motion
    dt_s: float
    step_s: float
    extrapolated_s: float
    before: Photometry
    likely: tuple[Likely, ...]
    follows_hypotheses: bool


class FittedFrame(NamedTuple):
    """A fit, and the frame as preprocessed for it."""

    fit: Fit
    frame: Frame


class Frames:
    """Prepares the images of a run in order; learned appearance and contrast stretch follow their illumination."""

    def __init__(self, fitter: EdgeFitter, state: TrackState, config: RobustConfig) -> None:
        self.fitter, self.state, self.config = fitter, state, config
        self.stretch = ContrastStretch()
        self.order = StampOrder()
        self.seen_rows: Image | None = None
        self.ok_rows: Image | None = None
        self.step_s = 0.0

    def is_new(self, image: Image, stamp_ns: int) -> bool:
        """Whether a frame is later than all previous ones and not identical to the last; stores it.

        ImageError for a grey image after coloured ones, or the reverse: edges are known by their colours.
        """
        if self.seen_rows is not None and self.seen_rows.ndim != image.ndim:
            kinds = ("grey", "BGR") if image.ndim == 2 else ("BGR", "grey")
            raise ImageError(
                f"the image is {kinds[0]}, those before were {kinds[1]}; give all of a run in grey, or all in BGR"
            )
        return self.comes_after(stamp_ns) and not self.is_frozen(image)

    def comes_after(self, stamp_ns: int) -> bool:
        """Whether a frame is later than all previous ones; stores its stamp."""
        latest_ns = self.order.latest_ns
        self.step_s = 0.0 if latest_ns is None else (stamp_ns - latest_ns) * 1e-9
        return self.order.is_later(stamp_ns)

    def is_frozen(self, image: Image) -> bool:
        """Whether a frame is identical to the previous one; stores some of its rows."""
        last, self.seen_rows = self.seen_rows, image[::ROWS_APART].copy()
        return last is not None and last.data == self.seen_rows.data  # up to the first pixel that differs

    def prepared(self, raw: Image, stamp_ns: int, expected: Motion | None, clock: StageClock) -> Frame:
        """A frame, stretched and smoothed as necessary, with the more certain prediction, the vehicle's or its own."""
        state = self.state
        dt_s = 0.0 if state.ok_ns is None else (stamp_ns - state.ok_ns) * 1e-9
        with clock.stage("denoise"):
            if state.ok_ns is None:
                self.stretch = ContrastStretch.needed(raw, self.config.preprocessing)
            stretched = self.stretch.of(raw)
            image = smoothed(stretched, self.config.preprocessing)
            self.fitter.begin(stamp_ns, self.step_s, self.fitter.sharpening.undone(stretched))
        with clock.stage("predict"):
            predicted = state.predicted(dt_s, stamp_ns)
            self.fitter.move(state.motion.velocity if dt_s < self.config.slow_s else None)
            if expected is not None and expected.spread_m(state.range_m) < predicted.spread_m(state.range_m):
                only = (Likely(expected),)
                return Frame(raw, image, expected, dt_s, self.step_s, 0.0, self.photometry, only, False)
            likely = state.likely(predicted, stamp_ns)
            fresh = bool(state.hypotheses) and stamp_ns - state.hypotheses[0].stamp_ns <= round(self.step_s * 1e9)
        return Frame(raw, image, predicted, dt_s, self.step_s, dt_s, self.photometry, likely, fresh)

    def compensated(self, frame: Frame, fit: Fit, clock: StageClock) -> FittedFrame:
        """Fit and frame after gain-offset compensation of the learned colours, if that increases the support."""
        config = self.config.preprocessing
        if self.state.is_first or fit.support >= self.state.usual_or_good():
            return FittedFrame(fit, frame)
        if self.ok_rows is None or self.seen_rows is None or self.ok_rows.shape != self.seen_rows.shape:
            return FittedFrame(fit, frame)
        stretch, ratio = (
            ContrastStretch.needed(frame.raw, config),
            brightness_ratio(self.seen_rows, self.ok_rows),
        )
        stretch = stretch if stretch.differs(self.stretch, config.min_gain) else self.stretch
        if stretch == self.stretch and (ratio == 1).all():
            return FittedFrame(fit, frame)
        colours, unsmoothed, stretched = self.fitter.appearance, self.fitter.unsmoothed, stretch.of(frame.raw)
        image = smoothed(stretched, config)
        self.fitter.locate_in(self.fitter.sharpening.undone(stretched))
        self.fitter.appearance = compensated(colours, self.fitter.seen_rows, self.stretch.towards(stretch, ratio))
        other = self.fitter.fit(image, frame.predicted.cam_from_world, frame.predicted.covariance, clock)
        if other.finite and other.support > fit.support:
            self.stretch = stretch
            return FittedFrame(other, frame._replace(image=image))
        self.fitter.appearance = colours
        self.fitter.locate_in(unsmoothed)
        return FittedFrame(fit, frame)

    @property
    def photometry(self) -> Photometry:
        """Copy of the learned appearance and the stretch."""
        return Photometry(self.fitter.appearance, self.stretch, self.ok_rows)

    def restore(self, before: Photometry) -> None:
        """Restore the state from before a wrong pose."""
        self.fitter.appearance, self.stretch, self.ok_rows = before
