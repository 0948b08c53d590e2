"""Pictures of the ground truth of a frame, colour-coded, each with a legend that says how to read it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.reports.figures.tracker_pictures import GREEN, draw
from uavbench.scenes.dataset.sequence import EDGE_COLUMNS, Sequence
from uavbench.scenes.generate import generate
from uavbench.scenes.spec import Annotation, SequenceSpec
from uavbench.tracker.protocol import Image
from uavbench.trajectories.pose import Array

NOWHERE = (60, 60, 60)
"""Colour (BGR) of pixels without a value: the sky's depth and normals."""
INSTANCES = {1: ("structure", (60, 200, 255)), 2: ("plants", (70, 180, 60)), 3: ("people", (200, 80, 220)),
             4: ("birds", (255, 170, 60))}  # fmt: skip
LOOKALIKES = ("lookalikes", (60, 60, 230))
"""Names and colours (BGR) of the values of a mask; from 10 on the last."""
DIMMED = 0.45
"""Brightness of a frame under its mask, and of the flow of points that the next frame does not show."""
FAR_PERCENT = 98.0
"""Percentile of the depths and of the flow's sizes that gets the last colour."""
LEGEND_PX, MARGIN_PX, FONT = 64, 8, 0.42
"""Size of a legend's wheel, ball or bar, its distance to the border, and the scale of its font."""


@dataclass(frozen=True, eq=False)
class Annotated:
    """A frame (h, w, 3) BGR and its ground truth as read from a sequence, sizes as of `Frame`."""

    image: Image
    depth_m: Array
    mask: NDArray[np.uint8]
    edges: Array
    flow_px: Array
    occlusion: NDArray[np.uint8]
    normals: Array


def annotation_picture(spec: SequenceSpec) -> Image:
    """Image (h, w, 3) BGR of the spec's only annotation, of the frame in the middle of its flight."""
    (kind,) = spec.annotations
    return DRAWN[kind](_annotated(replace(spec, name="", annotations=get_args(Annotation))))


@lru_cache(maxsize=1)
def _annotated(spec: SequenceSpec) -> Annotated:
    """The frame with all annotations, cached: its pictures share one."""
    with TemporaryDirectory(prefix="uavbench-gallery-") as scratch:
        generate(spec, Path(scratch) / "sequence", content_hash="picture of the gallery")
        sequence = Sequence.load(Path(scratch) / "sequence")
        frame = sequence[len(sequence) // 2]
        found = (frame.depth_m, frame.mask, frame.edges, frame.flow_px, frame.occlusion, frame.normals)
        depth_m, mask, edges, flow_px, occlusion, normals = found
        assert depth_m is not None and mask is not None and edges is not None
        assert flow_px is not None and occlusion is not None and normals is not None
        return Annotated(frame.image, depth_m, mask, edges, flow_px, occlusion, normals)


def depth_picture(frame: Annotated) -> Image:
    """Depth from near (yellow) to far (blue), with a bar in metres."""
    known = frame.depth_m > 0
    near, far = float(frame.depth_m[known].min()), float(np.percentile(frame.depth_m[known], FAR_PERCENT))
    share = np.clip((frame.depth_m - near) / (far - near), 0, 1)
    picture = _shades(share)
    picture[~known] = NOWHERE
    bar = _shades(np.tile(np.linspace(0, 1, 2 * LEGEND_PX), (LEGEND_PX // 4, 1)))
    _paste(picture, bar, ("", f"{near:.2g} m", f"> {far:.2g} m"))
    return picture


def mask_picture(frame: Annotated) -> Image:
    """Instances in colours over the darkened frame, with their names."""
    picture = np.asarray(DIMMED * frame.image, dtype=np.uint8)
    named = []
    for value in np.unique(frame.mask[frame.mask > 0]).tolist():
        name, colour = INSTANCES.get(value, LOOKALIKES)
        picture[frame.mask == value] = colour
        named.append((f"{value} {name}", colour))
    height = 16 * len(named) + 6
    corner = picture[-height - MARGIN_PX : -MARGIN_PX, MARGIN_PX : MARGIN_PX + 2 * LEGEND_PX]
    corner[:] = 28
    for k, (words, colour) in enumerate(named):
        cv2.rectangle(corner, (5, 16 * k + 6), (15, 16 * k + 16), colour, -1)
        _write(corner, words, (21, 16 * k + 16))
    return picture


def edges_picture(frame: Annotated) -> Image:
    """The visible parts of the model's edges over the frame."""
    picture = frame.image.copy()
    ends = [EDGE_COLUMNS.index(name) for name in ("u0_px", "v0_px", "u1_px", "v1_px")]
    draw(picture, frame.edges[:, ends].reshape(-1, 2, 2), GREEN, 1)
    return picture


def flow_picture(frame: Annotated) -> Image:
    """Direction of the flow as hue and its size as saturation, with their wheel; dark where the next frame has none."""
    size = np.linalg.norm(frame.flow_px, axis=2)
    largest = float(np.nanpercentile(size, FAR_PERCENT))
    picture = flow_colours(frame.flow_px / largest)
    unseen = frame.occlusion > 0
    picture[unseen] = (DIMMED * picture[unseen]).astype(np.uint8)
    place, inside = _disc()
    wheel = flow_colours(place)
    _paste(picture, np.where(inside[..., None], wheel, 28).astype(np.uint8), (f"{largest:.2g} px", "", ""))
    return picture


def flow_colours(flow: Array) -> Image:
    """Colours (h, w, 3) BGR of flow (h, w, 2) as a share of the largest: to the right red, down yellow-green.

    White at rest, hue by direction, as saturated as large (as the colour wheel of Baker et al., IJCV 2011); black where
    it is not known.
    """
    known: NDArray[np.bool_] = np.asarray(np.isfinite(flow).all(axis=2))
    u, v = np.moveaxis(np.where(known[..., None], flow, 0.0), 2, 0)
    hue = np.degrees(np.arctan2(v, u)) % 360
    codes = np.dstack([hue / 2, 255 * np.clip(np.hypot(u, v), 0, 1), 255.0 * known])
    return np.asarray(cv2.cvtColor(np.rint(codes).astype(np.uint8), cv2.COLOR_HSV2BGR), dtype=np.uint8)


def normals_picture(frame: Annotated) -> Image:
    """Normals as colours, with a ball that has all that a camera can see."""
    picture = normal_colours(frame.normals)
    place, inside = _disc()
    x, y = np.moveaxis(place, 2, 0)
    ball = np.dstack([x, y, -np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))])
    _paste(picture, np.where(inside[..., None], normal_colours(ball), 28).astype(np.uint8), ("", "", ""))
    return picture


def normal_colours(normals: Array) -> Image:
    """Colours (h, w, 3) BGR of unit normals (h, w, 3) in the camera's frame: red right, green up, blue to the camera.

    Half of a colour stands for 0, as is customary of normal maps.
    """
    known: NDArray[np.bool_] = np.asarray(np.isfinite(normals).all(axis=2))
    axes = np.where(known[..., None], normals, 0.0) * [1.0, -1.0, -1.0]
    colours = np.rint(255 * (axes[..., ::-1] + 1) / 2).astype(np.uint8)
    colours[~known] = NOWHERE
    return np.asarray(colours)


DRAWN: Mapping[str, Callable[[Annotated], Image]] = {
    "depth": depth_picture,
    "mask": mask_picture,
    "edges": edges_picture,
    "flow": flow_picture,
    "normals": normals_picture,
}
"""Annotation -> how it is drawn."""


def _shades(share: Array) -> Image:
    """Colours (h, w, 3) BGR of values from 0, yellow, to 1, dark blue."""
    codes = np.rint(255 * (1 - share)).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(codes, cv2.COLORMAP_VIRIDIS), dtype=np.uint8)


def _disc() -> tuple[Array, NDArray[np.bool_]]:
    """Positions (n, n, 2) in a legend from -1 to 1, x to the right and y down; and whether they are in its circle."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, LEGEND_PX)] * 2)
    return np.dstack([x, y]), np.hypot(x, y) <= 1


def _paste(picture: Image, legend: Image, words: tuple[str, str, str]) -> None:
    """Put a legend into the lower left corner; words right of it, or below a bar at its left and right end."""
    beside, left, right = words
    height, width = legend.shape[:2]
    room = 16 * bool(left), 46 * bool(beside)
    top, x = picture.shape[0] - MARGIN_PX - height - room[0] - 8, MARGIN_PX
    corner = picture[top : top + height + room[0] + 8, x : x + width + room[1] + 8]
    corner[:] = 28
    corner[4 : 4 + height, 4 : 4 + width] = legend
    _write(corner, beside, (width + 8, 4 + height // 2 + 4))
    _write(corner, left, (4, height + 17))
    _write(corner, right, (width - 44, height + 17))


def _write(canvas: Image, words: str, at: tuple[int, int]) -> None:
    cv2.putText(canvas, words, at, cv2.FONT_HERSHEY_DUPLEX, FONT, (255, 255, 255), 1, cv2.LINE_AA)
