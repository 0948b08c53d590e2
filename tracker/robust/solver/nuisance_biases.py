"""Biases shared across frames: the pose error of all patches together, and each edge's offset along its normal.

The image of an edge is offset from the model's edge by worn borders, shadows or insets, by the same fraction of a pixel
in successive frames. Frames are therefore not independent measurements: each offset is a state, and so is the pose
error shared by all patches. Since patches track the camera, the edges of all frames observe the same few unknowns,
which different viewpoints separate. Edges that look alike are offset alike, and count as less than so many edges.
"""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion, eliminate
from uavbench.tracker.robust.config.solver import BiasConfig
from uavbench.tracker.robust.solver.bias_kernels import (
    PatchError,
    accumulate,
    centre,
    explained_by_offsets,
    known_of,
    prior_offsets,
)
from uavbench.tracker.robust.solver.bias_state import (
    BIAS_STATE,
    EDGE_OFFSETS,
    FRAME_SUMS,
    BiasesInView,
    BiasState,
    EdgeOffsets,
    FrameSums,
    told_of,
)
from uavbench.tracker.robust.solver.edge_kinds import EdgeKinds
from uavbench.tracker.robust.solver.solve_kernels import Step
from uavbench.tracker.robust.solver.twist_kernels import adjoint, congruence
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, unchecked
from uavbench.trajectories.pose import Array, Pose

Indices = NDArray[np.int64]
NO_EDGES = EdgeOffsets(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))


@compiled("state f0", inner=True, allocates=False, state=BIAS_STATE)
def fade(state: BiasState, part: float) -> None:
    """Forget a part of what the frames before said, in place."""
    kept, common = 1.0 - part, len(state.vector)
    for i in range(common):
        state.vector[i] *= kept
        for j in range(common):
            state.information[i, j] *= kept
    for block in range(len(state.told)):
        for e in told_of(state, block):
            state.offset_information[e] *= kept
            state.offset_vector[e] *= kept
            for i in range(common):
                state.cross[e, i] *= kept


@compiled("f2 f2", inner=True)
def observability(E: Array, P: Array) -> float:
    """Observability of the pose by patches of information P (6, 6) relative to edges of information E (6, 6), 0 to 1.

    The mean fraction of the information in each direction of a twist that is due to the patches.
    """
    M, N = np.empty((6, 6)), np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            M[i, j], N[i, j] = E[i, j] + P[i, j], P[i, j]
    eliminate(M, N)
    return float(N[0, 0] + N[1, 1] + N[2, 2] + N[3, 3] + N[4, 4] + N[5, 5]) / 6.0


@compiled(
    "state edges sums f1 pose f0 f0",
    state=BIAS_STATE,
    edges=EDGE_OFFSETS,
    sums=FRAME_SUMS,
    pose=named_tuple(RigidMotion, "f2 f1"),
)
def take_up(
    state: BiasState,
    edges: EdgeOffsets,
    sums: FrameSums,
    to_patches: Array,
    at: RigidMotion,
    new: float,
    forgotten_part: float,
) -> PatchError:
    """Add a part `new` of a frame's sums to the state, in place, and forget so much of the frames before.

    to_patches (6,): twist from the linearization point of the sums to the pose by the patches.
    """
    fade(state, forgotten_part * new)
    edges_tell = np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            edges_tell[i, j] = sums.edge_information[i, j]
    part = new * observability(edges_tell, sums.patch_information)
    accumulate(state, edges, sums, to_patches, at.R, at.t, part)
    return centre(state, np.zeros(len(state.vector) - 6), at.R, at.t)


class NuisanceBiases:
    """State of the filter: information on the patches' pose error and on the offsets of all edges."""

    def __init__(self, kinds: EdgeKinds, config: BiasConfig, numbers: int, sides: int) -> None:
        self.config, self.kinds, self.numbers = config, kinds, numbers
        self.nothing, self.state = BiasState.unknown(kinds, numbers + sides), BiasState.unknown(kinds, numbers)
        self.known, self.known_of_nothing = known_of(self.state).known, known_of(self.nothing).known
        self.is_forgotten = False

    def offsets(self, rows: Indices, variance_px2: Array, shared_part: float) -> EdgeOffsets:
        """Offsets of edges in view, rows (g,) of the state, with prior variances (g,).

        shared_part: part of the variance that edges of a kind share; of a kind it is that of their mean.
        """
        return prior_offsets(self.state, rows, variance_px2, shared_part)

    def seen_with(self, edges: EdgeOffsets) -> BiasesInView:
        """The biases with these edges in view."""
        return BiasesInView(self.state, self.known, edges)

    def before(self, edges: EdgeOffsets) -> BiasesInView:
        """The biases with these edges in view before any frame, with the offsets that all share as numbers more."""
        return BiasesInView(self.nothing, self.known_of_nothing, edges)

    def begin(self, edges: EdgeOffsets, sums: FrameSums, step: Step, prior: Array, pose: Pose) -> None:
        """Reset for patches created at a pose, from the sums of that frame and the information (6, 6) of a prior.

        step: from the linearization point of the sums to that pose, and to the numbers by which it is that pose.
        """
        R, t = pose.rotation, pose.translation
        self.state = state = BiasState.unknown(self.kinds, self.numbers)
        state.information[:] = 0.0
        accumulate(state, edges, sums, step.to_fit, R, t, 1.0)
        state.information[:6, :6] += congruence(np.ascontiguousarray(adjoint(R, t).T), prior)
        spared = explained_by_offsets(state)
        state.vector[:] = spared.vector + (state.information - spared.information)[:, 6:] @ step.to_numbers
        self.known, self.is_forgotten = known_of(state).known, False

    def forget(self) -> None:
        """Forget all frames; at once where that was done, as without patches in every frame."""
        if self.is_forgotten:
            return
        self.state = BiasState.unknown(self.kinds, self.numbers)
        self.known, self.is_forgotten = known_of(self.state).known, True

    def learn(self, edges: EdgeOffsets, sums: FrameSums, to_patches: Array, pose: Pose, dt_s: float) -> Array:
        """Add a frame's sums, dt_s after the previous frame, and return the patches' error as a twist (6,).

        to_patches (6,): twist from the linearization point of the sums to the pose by the patches.
        """
        new, at = min(1.0, dt_s / self.config.correlation_s), RigidMotion(pose.rotation, pose.translation)
        error = unchecked(take_up)(self.state, edges, sums, to_patches, at, new, self.config.forgotten_part)
        self.known, self.is_forgotten = error.known, False
        return error.twist

    def follow(self, moved: Array, pose: Pose) -> Array:
        """Follow a change (r,) of the numbers by which edges are located; the patches' error as a twist (6,)."""
        error = unchecked(centre)(self.state, moved, pose.rotation, pose.translation)
        self.known, self.is_forgotten = error.known, False
        return error.twist
