"""Flying clutter: birds circling around the structure with varying height."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.renderables import BuiltClutter, Mover, Part
from uavbench.trajectories.pose import Array, Pose, rotation_exp

INSTANCE = 4


@dataclass(frozen=True)
class Birds:
    """Birds circling around and above the structure; their number is 10 times density, rounded."""

    density: Annotated[float, Interval(ge=0, le=20)] = 0.5
    span_m: Annotated[float, Gt(0.01), Interval(le=5)] = 0.7
    speed_m_s: Annotated[float, Gt(0), Interval(le=40)] = 7.0

    def build(self, bounds: Array, rng: np.random.Generator) -> BuiltClutter:
        """Movers around a structure of bounds (2, 3) in metres, world frame; no path crosses the bounds.

        Radius, height, speed, phase and plumage of each bird are drawn from rng.
        """
        extent = float(np.linalg.norm((bounds[1] - bounds[0])[:2]) / 2)
        movers = []
        for _ in range(round(10 * self.density)):
            tone = float(rng.uniform(0.02, 0.5))
            radius = extent + self.span_m + float(rng.uniform(1.0, 12.0))
            height = float(bounds[1, 2]) * float(rng.uniform(0.5, 1.8)) + float(rng.uniform(0.5, 3.0))
            path = Circling(
                np.array([*bounds.mean(axis=0)[:2], height]),
                radius,
                self.speed_m_s * float(rng.uniform(0.7, 1.3)) * float(rng.choice([-1.0, 1.0])),
                float(rng.uniform(0, 2 * np.pi)),
                float(rng.uniform(4, 9)),
            )
            movers.append(Mover(_bird(self.span_m * float(rng.uniform(0.7, 1.3)), tone), path))
        return BuiltClutter(movers=tuple(movers))


@dataclass(frozen=True, eq=False)
class Circling:
    """Circular flight at constant speed in a coordinated turn, with a sinusoidal height variation of 0.6 m.

    centre (3,) in the world frame, metres; speed_m_s is negative for clockwise flight seen from above; start_rad is the
    initial azimuth; period_s is that of the height variation. The bank angle is atan(v^2 / (g r)).
    """

    centre: Array
    radius_m: float
    speed_m_s: float
    start_rad: float
    period_s: float

    def __call__(self, time_s: float) -> Pose:
        """Pose `world_from_part` at a time in seconds; the bird's x axis points forwards."""
        angle = self.start_rad + self.speed_m_s / self.radius_m * time_s
        wave = 0.6 * np.sin(2 * np.pi * time_s / self.period_s + self.start_rad)
        place = self.centre + np.array([self.radius_m * np.cos(angle), self.radius_m * np.sin(angle), wave])
        heading = angle + np.sign(self.speed_m_s) * np.pi / 2
        bank = -np.sign(self.speed_m_s) * np.arctan(self.speed_m_s**2 / (9.81 * self.radius_m))
        turn = rotation_exp(np.array([0.0, 0.0, heading])) @ rotation_exp(np.array([bank, 0.0, 0.0]))
        return Pose(turn, place)


def _bird(span: float, tone: float) -> Part:
    """Two-sided mesh of a body and bent wings of a wingspan in metres, dark with a lighter underside."""
    s = span
    points = np.array(
        [[0.26, 0, 0], [-0.30, 0, 0], [0, 0, 0.05], [0, 0, -0.06], [0.08, 0.06, 0.01], [-0.10, 0.05, 0.0],
         [0.10, 0.26, 0.07], [-0.02, 0.5, 0.02], [-0.10, 0.26, 0.06], [-0.36, 0.06, 0.0]]
    ) * s  # fmt: skip
    right = points * [1, -1, 1]
    half = np.array(
        [[0, 4, 2], [4, 5, 2], [5, 1, 2], [0, 3, 4], [4, 3, 5], [5, 3, 1], [4, 6, 8], [4, 8, 5], [6, 7, 8], [1, 5, 9]]
    )
    n = len(points)
    vertices = np.concatenate([points, right])
    triangles = np.concatenate([half, half[:, ::-1] + n])
    color = np.array([tone, tone, 1.05 * tone])
    tint = np.concatenate([np.tile(color, (2 * n, 1)), np.ones((2 * n, 1))], axis=1)
    tint[[3, 3 + n], :3] = min(1.0, 2.5 * tone + 0.1)
    return Part(vertices=vertices, triangles=triangles, tint=tint, two_sided=True, roughness=1.0, instance=INSTANCE)
