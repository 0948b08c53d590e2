"""Runs a tracker on real images of a folder, a video or a topic of a ROS 2 bag; writes results and an overlay video."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.body import Body
from uavbench.scenes.dataset.verify import file_hash
from uavbench.scenes.image_files import (
    SUFFIXES,
    OneTurn,
    begin_video,
    finish_video,
    image_of,
    is_shown,
    open_video,
)
from uavbench.scenes.structure import Structure
from uavbench.tracker.images.bag_images import StampedImage, bag_frames, bag_rate_hz
from uavbench.tracker.images.camera_doubts import doubts_of_camera, doubts_of_info
from uavbench.tracker.images.image_levels import BlackImages, RepeatedImages
from uavbench.tracker.images.image_names import by_numbers, doubts_of_names, in_seconds, refuse_twins
from uavbench.tracker.images.image_times import doubts_of_times
from uavbench.tracker.images.model_size import doubts_of_size
from uavbench.tracker.images.overlay import draw_edges, share_on_edges
from uavbench.tracker.images.video_images import VideoImages
from uavbench.tracker.initialization import read_init
from uavbench.tracker.protocol import Image, Tracker, TrackResult
from uavbench.tracker.registry import tracker_kind
from uavbench.tracker.results import MARKER, Results
from uavbench.tracker.run import own_copy, record_of, started, track_frame
from uavbench.trajectories.bags.reading import BagTopic
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import IMAGE
from uavbench.trajectories.files.origin import refuse_foreign
from uavbench.trajectories.files.reading import read_bytes
from uavbench.trajectories.files.writing import new_folder
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.random_streams import stream

UNKNOWN_BODY = Body(Pose.identity(), {})
"""Mounting of the camera, which is unknown for real images."""
SHOWN_HZ = (0.1, 1000.0)
"""Slowest and fastest frame rate of the overlay in Hz; a video's header may claim any, MP4 takes 0.01 to 65535."""
RATES_HZ = (1e-3, 1e6)
"""Lowest and highest rate of images: their stamps, whole nanoseconds, stay apart and below 2^63."""
RATE_HZ = 30.0
"""Rate of the images of a folder unless it is given."""
SAME_RATE = 0.1
"""Share by which a rate may differ from that of a video or a topic: it is rounded, or the mean of a variable one."""
WELL_PLACED, BETTER_PLACED = 0.5, 0.2
"""Share of the model's edges that lie on edges of the first image, above which a pose fits it, and by how much more the
inverse must have. At right poses of boxes it is 0.8, at others 0 to 0.7: floors have edges, too."""
SEED = 0
"""Seed of the tracker's random numbers."""


def track_images(
    tracker: Tracker,
    source: Path | BagTopic,
    *,
    model: Path,
    camera: Path,
    init: Path,
    out: Path,
    rate_hz: float = RATE_HZ,
) -> Results:
    """Track the images of a folder, of a video or of a topic of a ROS 2 bag, and write `out`.

    `out` gets frames.csv, times.csv, estimate_world_from_cam.tum (world: the model's frame), record.json and
    overlay.mp4.
    The images of a folder are sorted by name, 9.png before 10.png, and stamped 1 / rate_hz apart; a video has its own
    times, a bag the stamps of its headers. `doubts` of the record tells of images that could not be read, are nearly
    black, are the one before again, or seem to be missing, of files with times beside them, of a model that seems to be
    in another unit, of a principal point of another convention, and of a `camera_info` beside a topic that tells
    another camera, and, where no frame has a pose, of the initial pose.
    UserError naming the invalid file.
    """
    refuse_foreign(out, MARKER)
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise UserError(f"rate {rate_hz:g} Hz: images have {RATES_HZ[0]:g} to {RATES_HZ[1]:,.0f} Hz")
    lens = Camera.load(camera)
    structure = load_model(model)
    first = read_init(init, lens, structure)
    rng = stream(SEED, "tracker", tracker_kind(tracker))
    run = started(own_copy(tracker), structure, lens, first, rng, UNKNOWN_BODY)
    rate_hz = rate_of(source, rate_hz)
    rows: list[TrackResult] = []
    errors: list[str] = []
    stamps: list[int] = []
    opening: Image | None = None
    levels, repeated = BlackImages(), RepeatedImages()
    images = frames(source, lens, rate_hz)
    with new_folder(out, MARKER) as new:
        shown_hz = min(max(rate_hz, SHOWN_HZ[0]), SHOWN_HZ[1])
        writer = begin_video(new / "overlay.mp4", "mp4v", shown_hz, (lens.width, lens.height))
        for frame, (stamp_ns, image) in enumerate(images):
            opening = image if opening is None else opening
            levels.see(image)
            repeated.see(image)
            result, error = track_frame(run, image, stamp_ns)
            if error:
                errors.append(f"frame {frame}: {error}")
            rows.append(result)
            stamps.append(stamp_ns)
            writer.write(draw_edges(image, structure, lens, result))
        finish_video(writer, new / "overlay.mp4", len(rows))
        if opening is None:
            raise UserError(f"{source}: no images ({', '.join(SUFFIXES)}) in it")
        name = str(source) if isinstance(source, BagTopic) else source.name
        inputs = {"sequence": {"name": name, "model": file_hash(model), "camera": file_hash(camera)}}
        record = record_of(tracker, inputs, Pose.identity(), rate_hz=rate_hz, seed=SEED, errors=errors)
        located = any(row.cam_from_world is not None for row in rows)
        record["doubts"] = [
            *([] if located else _doubts_of_start(opening, structure, lens, first, init)),
            *doubts_of_camera(lens),
            *doubts_of_size(structure, first),
            *_doubts(source, images, rate_hz, lens),
            *levels.doubts(name),
            *([] if isinstance(images, VideoImages) else repeated.doubts(name)),
        ]
        results = Results(record, np.arange(len(rows)), np.array(stamps, dtype=np.int64), tuple(rows))
        results.write(new)
    return results


def _doubts(source: Path | BagTopic, images: Iterable[StampedImage], rate_hz: float, camera: Camera) -> list[str]:
    """Messages on images that could not be read, seem to be missing, or have another camera by their bag."""
    if isinstance(images, VideoImages):
        return images.doubts
    if isinstance(source, BagTopic):
        return doubts_of_info(source, camera)
    return [*doubts_of_names(in_order(source), rate_hz), *doubts_of_times(source, rate_hz)]


def _doubts_of_start(opening: Image, structure: Structure, camera: Camera, first: Pose, init: Path) -> list[str]:
    """Message on an initial pose at which the model is not on the edges of the first image, or is at its inverse."""
    given, inverse = (share_on_edges(opening, structure, camera, pose) for pose in (first, first.inverse()))
    head = f"no frame has a pose, and at that of {init} only {100 * given:.0f} % of the model's edges lie on edges of "
    if inverse > max(WELL_PLACED, given + BETTER_PLACED):
        return [
            f"{head}the first image, at its inverse {100 * inverse:.0f} %: is it world_from_cam in place of "
            "cam_from_model? Give the inverse"
        ]
    if given < WELL_PLACED:
        return [
            f"{head}the first image: is it the pose of this image, are camera and model those of these images, and are "
            "both model and pose in metres?"
        ]
    return []


def load_model(path: Path) -> Structure:
    """Structure of a model file in metres, with its origin; z up, to which glTF is turned. UserError naming it."""
    from uavbench.scenes.model_files.mesh_file import (
        MeshFile,  # lazy: a vehicle with a ready structure does not need the readers
    )

    return MeshFile(path=str(path), keep_origin=True, allow_open=True).shape()


def frames(source: Path | BagTopic, camera: Camera, rate_hz: float) -> Iterable[StampedImage]:
    """Stamps in ns and BGR images of a folder, a video (`VideoImages`), or a topic of a bag."""
    if isinstance(source, BagTopic):
        return bag_frames(source, camera)
    if source.is_dir():
        refuse_twins(images := in_order(source))
        return _of_folder(images, camera, rate_hz)
    return VideoImages(source, camera, rate_hz)


def _of_folder(images: list[Path], camera: Camera, rate_hz: float) -> Iterator[StampedImage]:
    alike = OneTurn()
    for frame, path in enumerate(images):
        data = read_bytes(path, IMAGE)
        alike.check(path, data)
        yield StampedImage(round(frame * 1e9 / rate_hz), image_of(path, data, camera))


def in_order(folder: Path) -> list[Path]:
    """Images of a folder, without hidden ones, sorted by name: numbers and seconds by value, 9.png before 10.png."""
    images = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and is_shown(path, folder)]
    seconds = in_seconds(images)
    return sorted(images, key=lambda path: (by_numbers(path.stem, seconds), path.suffix, path.name))


def rate_of(source: Path | BagTopic, rate_hz: float) -> float:
    """Frame rate in Hz of a video or a topic of a bag; rate_hz for a folder, or if the rate is unknown."""
    if isinstance(source, BagTopic):
        rate = bag_rate_hz(source)
    elif source.is_dir():
        return rate_hz
    else:
        rate = float(open_video(source).get(cv2.CAP_PROP_FPS))
    return rate if rate > 0 else rate_hz


def refuse_another_rate(source: Path | BagTopic, rate_hz: float) -> None:
    """UserError for a rate in Hz that is not that of a video or of a topic of a bag: their own times are taken."""
    own_hz = rate_of(source, rate_hz)
    if abs(own_hz - rate_hz) > SAME_RATE * rate_hz:
        by = "" if isinstance(source, BagTopic) else f" by `ffmpeg -i {source.name} -fps_mode passthrough DIR/%06d.png`"
        raise UserError(
            f"{source}: its images have times of their own, {own_hz:.4g} a second, which --rate-hz {rate_hz:g} does "
            f"not change; leave it out, or, where these times are wrong, write the images{by}, and give --images DIR"
        )
