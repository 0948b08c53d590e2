"""What errs alike in all frames: the place of all patches together, and each edge by an offset along its normal.

An edge's points lie beside the model's edge by its worn border, a shadow or what is set into a face, by the same part
of a pixel in frame after frame. So frames are no independent witnesses: each offset is a state, and so is the pose
error that all patches rest on. What the patches tell of the camera makes the edges of all frames speak of the same few
unknowns, and viewpoints that differ tell them apart.
"""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.config.solver import BiasConfig
from uavbench.tracker.robust.solver.bias_kernels import (
    Sums,
    adjoint,
    centre,
    explained,
    pinned,
    shared_at,
    take_up,
    turned,
)
from uavbench.trajectories.pose import Array, Pose

Indices = NDArray[np.int64]


class CommonErrors:
    """Information on the patches' common error and on the offsets of edges."""

    def __init__(self, edges: int, config: BiasConfig) -> None:
        self.config = config
        self.tie, self.seen, self.moment = np.zeros((edges, 6)), np.zeros(edges), np.zeros(edges)
        self.least = np.ones(edges)
        self.whole, self.vector, self.known = np.eye(6), np.zeros(6), np.eye(6)

    def at(self, edges: Indices, spread: Array, R: Array, t: Array) -> tuple[Array, Array, Array, Array, Array]:
        """What is known at a pose with these edges (g,) in view: see `map_kernels.shared_at`."""
        return shared_at(self.known, self.tie, self.seen, self.moment, self.least, edges, spread, R, t)

    def begin(self, edges: Indices, spread: Array, sums: Sums, aside: Array, prior: Array, pose: Pose) -> None:
        """Begin anew with patches taken at a pose, which the sums over a frame's edges and a prior (6, 6) tell."""
        R, t = pose.rotation, pose.translation
        self.tie[:], self.seen[:], self.moment[:] = 0.0, 0.0, 0.0
        self.whole[:], self.vector[:] = 0.0, 0.0
        take_up(*self._all, edges, spread, sums, aside, R, t, 1.0)
        self.whole += turned(np.ascontiguousarray(adjoint(R, t).T), prior)
        spared, self.vector[:] = explained(self.tie, self.seen, self.moment, self.least)
        self.known = self.whole - spared

    def learn(self, edges: Indices, spread: Array, sums: Sums, aside: Array, pose: Pose, dt_s: float) -> Array:
        """Take up a frame's sums over its edges at a pose, and return the twist (6,) by which the patches err.

        dt_s is the time since the frame before.
        """
        R, t = pose.rotation, pose.translation
        new = min(1.0, dt_s / self.config.correlation_s)
        for array in (self.whole, self.vector, self.tie, self.seen, self.moment):
            array *= 1.0 - self.config.forgotten_part * new
        take_up(*self._all, edges, spread, sums, aside, R, t, new * pinned(sums[3], sums[5]))
        twist, self.known = centre(*self._all, R, t)
        return twist

    @property
    def _all(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        return self.whole, self.vector, self.tie, self.seen, self.moment, self.least
