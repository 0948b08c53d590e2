"""`rapid`: control points, the nearest gradient maximum on each search line, least squares (Harris & Stennett 1990)."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.shang_shen.control_points import ControlPoints
from uavbench.tracker.shang_shen.edge_search import MIN_GRADIENT, Candidates, search_gradient
from uavbench.tracker.shang_shen.pipeline import Published

RAPID_SEARCH_PX = 15.0
"""Half length of a search line, px: without hypotheses a longer one finds more wrong edges."""
RAPID_SPACING_PX = 20.0
"""Spacing of control points, px: RAPID uses few, 20 to 30 on a structure."""


@dataclass(frozen=True)
class Rapid(Published):
    """Parameters of `rapid`; min_gradient in grey levels per px."""

    control_point_spacing_px: Annotated[float, Gt(0)] = RAPID_SPACING_PX
    search_px: Annotated[float, Gt(0)] = RAPID_SEARCH_PX
    passes: Annotated[int, Ge(1)] = 1
    min_gradient: Annotated[float, Gt(0)] = MIN_GRADIENT

    def detect(self, gray: Image, camera: Camera) -> Image:
        """The image itself: RAPID searches without prior edge detection."""
        return gray

    def search(self, points: ControlPoints, edges: Image, camera: Camera) -> Candidates:
        """Maxima of the gradient on the search lines."""
        return search_gradient(points, edges, camera, self.search_px, self.min_gradient)
