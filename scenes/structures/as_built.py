"""Deviations of the rendered, as-built structure from the as-designed model given to trackers."""

from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Interval

from uavbench.scenes.renderables import Part
from uavbench.trajectories.errors import UserError, refuse_idle
from uavbench.trajectories.pose import Array

Record = dict[str, float | str]


class AsBuilt(NamedTuple):
    """The parts as built, and a record of the deviations by name: scale factors, displacements, missing pieces."""

    parts: tuple[Part, ...]
    record: Record


@dataclass(frozen=True)
class Deviation:
    """Random deviation of the structure as built from its design, drawn from the sequence's seed.

    scale_percent is the standard deviation of the scale error along each axis; the fraction displaced_share of the
    pieces is shifted by a normal deviate of displaced_m along each axis; the fraction missing_share is missing; bend_m
    is the deflection at the middle of the longest side (downwards for a structure that is longer than high, otherwise
    sideways). The largest piece is neither displaced nor missing, nor is one without a name.
    """

    scale_percent: Annotated[float, Interval(ge=0, le=20)] = 0.0
    displaced_share: Annotated[float, Interval(ge=0, le=1)] = 0.0
    displaced_m: Annotated[float, Interval(ge=0, le=10)] = 0.02
    missing_share: Annotated[float, Interval(ge=0, le=1)] = 0.0
    bend_m: Annotated[float, Interval(ge=-10, le=10)] = 0.0

    def __post_init__(self) -> None:
        refuse_idle(self, {"displaced_m": ("displaced_share",)})

    def apply(self, parts: tuple[Part, ...], bounds: Array, rng: np.random.Generator) -> AsBuilt:
        """Parts with the deviations applied; bounds (2, 3) of the structure as designed, world frame, metres.

        UserError for a share of the pieces of a structure that has none.
        """
        record: Record = {}
        draws = rng.random((len(parts), 2))
        shifts = self.displaced_m * rng.standard_normal((len(parts), 3))
        factors = 1 + self.scale_percent / 100 * rng.standard_normal(3)
        largest = int(np.argmax([np.ptp(part.vertices, axis=0).max() for part in parts]))
        for key in ("displaced_share", "missing_share"):
            if getattr(self, key) and not any(part.name for k, part in enumerate(parts) if k != largest):
                raise UserError(
                    f"deviation.{key} {getattr(self, key):g}: the structure has no pieces beside its largest one, of "
                    "which some could be; leave it out, or choose scale_percent or bend_m"
                )
        out: list[Part] = []
        for k, part in enumerate(parts):
            label = f"{part.name or 'piece'} #{k}"
            if k == largest or not part.name:
                out.append(part)
            elif draws[k, 0] < self.missing_share:
                record[f"missing: {label}"] = 1.0
            elif draws[k, 1] < self.displaced_share:
                record[f"displaced_m: {label}"] = " ".join(f"{value:.6f}" for value in shifts[k])
                out.append(replace(part, vertices=part.vertices + shifts[k]))
            else:
                out.append(part)
        if self.scale_percent > 0:
            record |= {f"scale_{axis}": float(factor) for axis, factor in zip("xyz", factors, strict=True)}
            out = [replace(part, vertices=part.vertices * factors) for part in out]
        if self.bend_m != 0:
            record["bend_m"] = self.bend_m
            out = [replace(part, vertices=_bent(part.vertices, bounds, self.bend_m)) for part in out]
        return AsBuilt(tuple(out), record)


def _bent(vertices: Array, bounds: Array, bend_m: float) -> Array:
    """Vertices (n, 3) deflected by a parabola over the longest side: zero at its ends, bend_m at its middle."""
    size = bounds[1] - bounds[0]
    along = int(np.argmax(size))
    across = 2 if along < 2 else 0
    share = (vertices[:, along] - bounds[0, along]) / size[along]
    out = vertices.copy()
    out[:, across] -= bend_m * 4 * share * (1 - share)
    return out
