"""The pictures of the documentation: `python -m uavbench.bench.gallery.docs_pictures DIR` writes those of docs/images.

`demo.jpg` is of the suite `paper`, the others of `docs_pictures.toml`. Without Blender `twin.jpg` is left out.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import cv2
import numpy as np
from PIL import Image as Pillow

from uavbench.bench.config.suite import load_suite, suite_of
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.said import say
from uavbench.bench.twin.blender import find_blender
from uavbench.bench.twin.twin import Tracing, make_twin
from uavbench.reports.figures.tracker_pictures import View
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.generate import generate
from uavbench.scenes.rendering.camera_simulator import light_of
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.protocol import Image
from uavbench.tracker.registry import TRACKERS
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import new_parts
from uavbench.trajectories.pose import Pose

FILE = Path(__file__).with_suffix(".toml")
MARKER = Marker("docs_pictures.json", "pictures of the documentation")
JPEG_QUALITY = 90

DEMO_FRAMES = (20, 80, 150)
DEMO_S = 10.2
"""Length of the flight of `paper` up to the last of these frames: a shorter flight begins in the same way."""
DEMO_PX = (480, 360)
GAP_PX = 6

TWINS = ("box", "wall", "bridge")
TWIN_SAMPLES = 16


@dataclass(frozen=True)
class Still:
    """A camera at rest: the name of a sequence, and its position and direction of view in the world."""

    sequence: str
    eye_m: tuple[float, float, float]
    bearing_deg: float
    elevation_deg: float

    def cam_from_world(self) -> Pose:
        """Pose of the camera."""
        mount = Mount(yaw_deg=self.bearing_deg, pitch_deg=self.elevation_deg)
        return mount.cam_from_body @ Pose(np.eye(3), np.array(self.eye_m)).inverse()


def write_docs_pictures(folder: Path) -> str | None:
    """Write the pictures into a folder, and return why the twin's is left out, None where it is not.

    The folder is made, or holds the pictures of an earlier run, which are replaced. UserError when another file is in
    the way, or a sequence cannot be rendered.
    """
    try:
        find_blender()
        missing = None
    except UserError as error:
        missing = str(error)
    with new_parts(folder, MARKER) as new, TemporaryDirectory(prefix="uavbench-docs-") as scratch:
        _save(demo_picture(Path(scratch)), new / "demo.jpg")
        for name, stills in views().items():
            _save(stills_picture(stills), new / f"{name}.jpg")
        if missing is None:
            _save(twin_picture(Path(scratch)), new / "twin.jpg")
    return missing


def demo_picture(scratch: Path) -> Image:
    """Frames of the suite `paper` side by side, in green the model at the pose that the tracker lsd estimates."""
    spec = load_suite(suite_file("paper")).sequences[0]
    assert isinstance(spec, SequenceSpec)
    path: Any = replace(spec.flight.path, duration_s=DEMO_S)  # type: ignore[type-var]
    sequence = _rendered(replace(spec, flight=replace(spec.flight, path=path)), scratch / "demo")
    results = track_sequence(TRACKERS["lsd"](), sequence, rate_hz=spec.rate_hz, seed=spec.seed)
    tiles = []
    for frame in DEMO_FRAMES:
        view = View.of(sequence.image(frame), sequence.camera, sequence.structure)
        overlay = view.overlay(results.rows[frame].cam_from_world)
        tiles.append(cv2.resize(overlay, DEMO_PX, interpolation=cv2.INTER_AREA))
        tiles.append(np.full((DEMO_PX[1], GAP_PX, 3), 255, dtype=np.uint8))
    return np.asarray(np.hstack(tiles[:-1]), dtype=np.uint8)


def stills_picture(stills: list[Still]) -> Image:
    """What cameras at rest see, in rows of two."""
    seen = [_seen(still) for still in stills]
    return np.asarray(np.vstack([np.hstack(seen[k : k + 2]) for k in range(0, len(seen), 2)]), dtype=np.uint8)


def _seen(still: Still) -> Image:
    spec = sequences()[still.sequence]
    camera = spec.camera.camera()
    with build_scene(spec).renderer(camera.width, camera.height) as renderer:
        return encode(light_of(renderer.color(still.cam_from_world(), camera)))


def twin_picture(scratch: Path) -> Image:
    """A frame of each of TWINS on the left, and of its path-traced twin on the right, one below the other."""
    rows = []
    for name in TWINS:
        drawn = _rendered(sequences()[name], scratch / name)
        third = len(drawn) // 3
        make_twin(drawn.folder, scratch / f"{name}-twin", Tracing(third, TWIN_SAMPLES))
        rows.append(np.hstack([drawn.image(third), Sequence.load(scratch / f"{name}-twin").image(1)]))
    return np.asarray(np.vstack(rows), dtype=np.uint8)


def sequences() -> Mapping[str, SequenceSpec]:
    """The sequences of `docs_pictures.toml` by name; UserError when one is not valid."""
    suite = suite_of({key: value for key, value in _tables().items() if key != "views"}, (), FILE)
    specs = [spec for spec in suite.sequences if isinstance(spec, SequenceSpec)]
    return dict(zip(_tables()["sequences"], specs, strict=True))


def views() -> Mapping[str, list[Still]]:
    """The cameras at rest of `docs_pictures.toml`, by the name of their picture."""
    return {name: [Still(**table) for table in tables] for name, tables in _tables()["views"].items()}


@cache
def _tables() -> dict[str, Any]:
    return tomllib.loads(FILE.read_text(encoding="utf-8"))


def _rendered(spec: SequenceSpec, folder: Path) -> Sequence:
    generate(spec, folder, content_hash="picture of the documentation")
    return Sequence.load(folder)


def _save(image: Image, path: Path) -> None:
    Pillow.fromarray(image[..., ::-1]).save(path, format="JPEG", quality=JPEG_QUALITY)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
def main(folder: Path) -> None:
    """Write the pictures of the documentation into FOLDER."""
    if (missing := write_docs_pictures(folder)) is not None:
        say(f"twin.jpg: not made: {missing}", err=True)
    say(folder)


if __name__ == "__main__":
    main()
