"""Roads with markings, meshed as adjacent strips of asphalt and paint."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.meshes import grid, merge
from uavbench.scenes.renderables import Part, Roadway, Texture
from uavbench.trajectories.pose import Array

LINE_M = 0.15
"""Width of a line, metres: 4 to 6 inches (MUTCD 2009, section 3A.06: "normal line")."""
DASH_M, GAP_M = 3.05, 9.14
"""A broken line, metres: segments of 10 feet and gaps of 30 feet (MUTCD 2009, section 3A.06)."""
EDGE_M = 0.25
"""Distance from the edge of the asphalt to the edge line, metres."""
PAINT_ALBEDO = 0.55
"""Linear albedo of worn white markings (EN 1436:2018, luminance factor class B5: at least 0.6 when new)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Carriageway:
    """A straight road along x from start_m to end_m, centred on y = 0.

    half_m is half its width, level_m the height of its surface; world frame, metres. instance and name are those of its
    parts.
    """

    start_m: float
    end_m: float
    half_m: float
    level_m: float
    instance: int = 0
    name: str = ""

    def parts(self, asphalt: Material, paint: Texture, marked: bool) -> list[Part]:
        """The asphalt and, if marked, the paint: two edge lines and a broken centre line."""
        if not marked:
            return [self._strips([(-self.half_m, self.half_m)], asphalt.texture, asphalt, self._cuts())]
        edge, line = self.half_m - EDGE_M, LINE_M / 2
        across = [-self.half_m, -edge, -edge + LINE_M, -line, line, edge - LINE_M, edge, self.half_m]
        strips = list(pairwise(across))
        dark = self._strips([strips[k] for k in (0, 2, 4, 6)], asphalt.texture, asphalt, self._cuts())
        white = self._strips([strips[1], strips[5]], paint, asphalt, self._cuts())
        dashes, gaps = (self._middle(strips[3], what, asphalt) for what in ((paint, True), (asphalt.texture, False)))
        return [merge([dark, *gaps]), merge([white, *dashes])]

    def _cuts(self) -> Array:
        """Positions x (n,) at which every strip is cut, so that adjacent strips share their vertices."""
        first = np.ceil(self.start_m / (DASH_M + GAP_M)) * (DASH_M + GAP_M)
        starts = np.arange(first - DASH_M - GAP_M, self.end_m, DASH_M + GAP_M)
        inner = np.sort(np.concatenate([starts + shift for shift in (0.0, DASH_M, DASH_M + GAP_M / 2)]))
        inner = inner[(inner > self.start_m + 0.01) & (inner < self.end_m - 0.01)]
        return np.array([self.start_m, *inner, self.end_m])

    def _middle(self, strip: tuple[float, float], what: tuple[Texture, bool], asphalt: Material) -> list[Part]:
        """The dashes of the centre line, or the gaps between them."""
        texture, painted = what
        cuts = self._cuts()
        out = []
        for a, b in pairwise(cuts.tolist()):
            on_dash = ((a + b) / 2) % (DASH_M + GAP_M) < DASH_M
            if on_dash == painted:
                out.append(self._strips([strip], texture, asphalt, np.array([a, b])))
        return out

    def _strips(self, strips: list[tuple[float, float]], texture: Texture, asphalt: Material, cuts: Array) -> Part:
        """One part of the strips between pairs of lateral positions (low, high), metres."""
        parts = []
        for low, high in strips:
            axes = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
            vertices, triangles, _ = grid(np.array([0.0, 0.0, self.level_m]), *axes, cuts, np.array([low, high]))
            parts.append(
                Part(
                    vertices=vertices,
                    triangles=triangles,
                    normals=np.tile([0.0, 0.0, 1.0], (len(vertices), 1)),
                    uv=vertices[:, :2] / np.array(asphalt.tile_m),
                    texture=texture,
                    roughness=asphalt.roughness,
                    casts_shadow=False,
                    instance=self.instance,
                    name=self.name,
                )
            )
        return merge(parts)


def paint() -> Texture:
    """The texture of worn white markings."""
    return np.full((1, 1, 3), round(255 * PAINT_ALBEDO**0.5), dtype=np.uint8)


def marked(parts: tuple[Part, ...], road: Roadway, asphalt: Material) -> tuple[Part, ...]:
    """The structure with the upper face of its road, as built, replaced by one with markings."""
    out: list[Part] = []
    for part in parts:
        if part.name != "road" or part.normals is None:
            out.append(part)
            continue
        top = (part.normals[part.triangles][:, :, 2] > 0.9).all(axis=1)
        seen = part.vertices[part.triangles[top]].reshape(-1, 3)
        low, high = seen.min(axis=0), seen.max(axis=0)
        lane = Carriageway(
            start_m=float(low[0]),
            end_m=float(high[0]),
            half_m=float(high[1] - low[1]) / 2,
            level_m=float(high[2]),
            instance=part.instance,
            name=part.name,
        )
        shift = np.array([0.0, (low[1] + high[1]) / 2, 0.0])
        out.append(replace(part, triangles=part.triangles[~top]))
        out += [replace(p, vertices=p.vertices + shift) for p in lane.parts(asphalt, paint(), marked=True)]
    return tuple(out)
