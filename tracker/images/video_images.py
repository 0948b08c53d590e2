"""Images of a video with the times that the file gives them."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.image_files import check_size, is_counted, open_video
from uavbench.tracker.images.bag_images import StampedImage
from uavbench.trajectories.errors import UserError

MOST_REPEATED = 0.25
"""Share of images equal to the one before up to which nothing is said: converted to a fixed rate, some are."""


@dataclass
class VideoImages:
    """Images of a video; also of one with a variable frame rate.

    rate_hz: of images that the file gives no later time than the one before. After iterating, `doubts` tells of these,
    of images that the file says it holds and that could not be read, and of many that repeat the one before: those of
    interlaced video OpenCV 5 takes as decoded, and gives what was in its memory, again and again.
    """

    source: Path
    camera: Camera
    rate_hz: float
    stamps_ns: list[int] = field(default_factory=list)
    untimed: list[int] = field(default_factory=list)
    repeated: int = 0

    def __iter__(self) -> Iterator[StampedImage]:
        """Stamps in ns, from the first image on, and BGR images; UserError naming a video without or of other ones."""
        video = open_video(self.source)
        first_ms = 0.0
        before = np.zeros(0, dtype=np.uint8)
        while True:
            good, image = video.read()
            if not good:
                break
            frame = len(self.stamps_ns)
            height, width = image.shape[:2]
            check_size(Path(f"{self.source}: frame {frame}"), width, height, self.camera)
            at_ms = float(video.get(cv2.CAP_PROP_POS_MSEC))
            first_ms = first_ms if frame else at_ms
            self.stamps_ns.append(self._stamp_ns(frame, at_ms - first_ms))
            self.repeated += np.array_equal(image, before)
            before = np.array(image, dtype=np.uint8)
            yield StampedImage(self.stamps_ns[-1], np.asarray(image, dtype=np.uint8))
        if not self.stamps_ns:
            raise UserError(f"{self.source}: not a readable video")

    def _stamp_ns(self, frame: int, told_ms: float) -> int:
        stamp_ns, before_ns = round(told_ms * 1e6), self.stamps_ns[-1] if frame else -1
        if stamp_ns > before_ns:
            return stamp_ns
        self.untimed.append(frame)
        return before_ns + max(1, round(1e9 / self.rate_hz))

    @property
    def doubts(self) -> list[str]:
        """Messages on the images read so far, their number and their times."""
        found = []
        video = open_video(self.source)
        told, read = int(video.get(cv2.CAP_PROP_FRAME_COUNT)), len(self.stamps_ns)
        if read < told and (is_counted(self.source) or not self._lasts(told / video.get(cv2.CAP_PROP_FPS))):
            found.append(
                f"{self.source}: {read} of {told} frames can be read{self._gap()}; it is damaged, or was cut without "
                "encoding it again"
            )
        if self.untimed:
            found.append(
                f"{self.source}: frame {self.untimed[0]} has no later time than the one before, {len(self.untimed)} of "
                f"{read} frames in all; they are taken 1 / {self.rate_hz:g} s apart; encode it again with its times"
            )
        if self.repeated > MOST_REPEATED * read:
            found.append(
                f"{self.source}: {self.repeated} of {read} frames are the one before again, to the last byte; if the "
                "video is interlaced, it cannot be decoded: deinterlace it (ffmpeg -i VIDEO -vf yadif NEW.mp4)"
            )
        return found

    def _lasts(self, duration_s: float) -> bool:
        """Whether the images go on to the end of a duration, which may count from before the first one."""
        steps = np.diff(self.stamps_ns, prepend=0)
        return bool(self.stamps_ns[-1] + 2 * steps.max() >= duration_s * 1e9)

    def _gap(self) -> str:
        """After which frame others are missing, where the times show a gap."""
        steps = np.diff(self.stamps_ns)
        if not len(steps) or steps.max() < 1.5 * np.median(steps):
            return ""
        frame = int(np.argmax(steps))
        return f", none for {steps[frame] / 1e9:.3g} s after frame {frame}"
