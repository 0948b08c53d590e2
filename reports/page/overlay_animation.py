"""The animated overlay of a sequence, and the frames of the page's scrubber."""

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Pillow

from uavbench.reports.figures.image_panels import error_text
from uavbench.reports.figures.tracker_pictures import Image, View, draw, write_text_on
from uavbench.reports.scoring.images import image_at
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.trajectories.files.writing import new_file

SCRUBBED_FRAMES = 200
"""Most frames of a sequence in the scrubber."""
MOVING_FRAMES = 100
"""Most frames of an animation."""
JPEG_QUALITY = 82
WEBP_QUALITY = 55
ANIMATION_WIDTH_PX = 480


def scrubbed(frames: int) -> list[int]:
    """Indices of the frames in the scrubber, for a sequence of so many: every k-th, SCRUBBED_FRAMES at most."""
    return list(range(0, frames, max(1, -(-frames // SCRUBBED_FRAMES))))


def write_frames(run: ScoredRun, folder: Path, moving: Path, on_frame: Callable[[int], None]) -> None:
    """Write the scrubber's frames of a run's sequence as JPEG into a folder, and its overlay `moving` as animated WebP.

    Model at the latest estimate in green, at the true pose in white. Each image is read once; on_frame(frame) is called
    while `image_at` has it cached. UserError when an image cannot be read.
    """
    folder.mkdir(parents=True, exist_ok=True)
    frames = scrubbed(len(run.sequence))
    animated = frames[:: max(1, -(-len(frames) // MOVING_FRAMES))]
    step_ms = round(float(np.diff(run.sequence.stamps_ns[animated]).mean()) / 1e6) if len(animated) > 1 else 100

    def drawn() -> Iterator[Pillow.Image]:
        for frame in frames:
            view = View.of(image_at(run.sequence, frame), run.sequence.camera, run.sequence.structure)
            with new_file(folder / f"{frame:06d}.jpg") as temporary:
                temporary.write_bytes(cv2.imencode(".jpg", view.image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1])
            on_frame(frame)
            if frame in animated:
                yield Pillow.fromarray(overlay_frame(run, view, frame)[..., ::-1])

    pictures = drawn()
    with new_file(moving) as temporary:
        next(pictures).save(
            temporary, format="WEBP", save_all=True, append_images=pictures, duration=step_ms, loop=0,
            quality=WEBP_QUALITY, method=0,
        )  # fmt: skip


def overlay_frame(run: ScoredRun, view: View, frame: int) -> Image:
    """One frame of the overlay, ANIMATION_WIDTH_PX wide at most, with the error written on it."""
    scale = min(1.0, ANIMATION_WIDTH_PX / view.image.shape[1])
    small = cv2.resize(view.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    canvas: Image = np.asarray(small, dtype=np.uint8)
    draw(canvas, view.projected(run.sequence.true_cam_from_world(frame)) * scale, (255, 255, 255), 1)
    draw(canvas, view.projected(run.latest_pose[frame]) * scale, (60, 220, 70), 2)
    latest = int(run.errors.frames[np.searchsorted(run.errors.frames, frame, side="right") - 1])
    write_text_on(canvas, f"{run.title}  frame {frame}  {error_text(run, latest).replace(chr(176), ' deg')}")
    return canvas
