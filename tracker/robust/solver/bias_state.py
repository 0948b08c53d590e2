"""State of the nuisance biases, and what a frame tells of them, as arrays for the compiled kernels.

With D the pose error of the patches as a twist in the world and b the offset of an edge in px, a frame whose pose is
determined by the patches observes the control points of that edge at J D + b. The information matrix is therefore an
arrowhead matrix: each offset is correlated with D alone, and can be marginalized separately. Edges that look alike, as
those of all sills, share a part of their offsets: this makes their prior a tree, whose leaves are marginalized first.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.mostly_zero import mostly_zero
from uavbench.tracker.robust.solver.edge_kinds import EdgeKinds
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

TOGETHER = 64
"""Edges that are passed over together where none of them was seen."""

Indices = NDArray[np.int64]


class FrameSums(NamedTuple):
    """Normal equations of a frame, before the biases and the prior.

    For each edge in view: offset_weight (g,) sum of weights, offset_jacobian (g, 6 + r) of weight times Jacobian for
    the pose and r numbers that all edges share, offset_residual (g,) of weight times residual. Over all control points:
    edge_information (6 + r, 6 + r), edge_vector (6 + r,); over the patches: patch_information (6, 6), patch_vector
    (6,).
    """

    offset_weight: Array
    offset_jacobian: Array
    offset_residual: Array
    edge_information: Array
    edge_vector: Array
    patch_information: Array
    patch_vector: Array


class KindSums(NamedTuple):
    """What edges say of the offsets that they share with their kind, their own offsets marginalized.

    information (k,) on each, cross (k, 6 + r) between it and what is common to all, and vector (k,).
    """

    information: Array
    cross: Array
    vector: Array


class BiasState(NamedTuple):
    """Information on D and r numbers that all edges share, and on the offsets of all edges (e,).

    information (6 + r, 6 + r) and vector (6 + r,) on what is common; cross (e, 6 + r) between it and an offset;
    offset_information (e,) and offset_vector (e,) on the offset itself, offset_prior (e,) the prior information on what
    is its own. kinds (e,) of edges that look alike, -1 of one that looks like no other, and signs (e,) of their
    normals; kind_prior (k,) the prior information on the offset that a kind shares. told (b,) whether frames told of
    any of each TOGETHER edges: of a large structure few were seen.
    """

    information: Array
    vector: Array
    cross: Array
    offset_information: Array
    offset_vector: Array
    offset_prior: Array
    kinds: Indices
    signs: Array
    kind_prior: Array
    told: NDArray[np.uint8]

    @classmethod
    def unknown(cls, kinds: EdgeKinds, numbers: int = 0) -> "BiasState":
        """Unit information on D, none on so many numbers, nor on offsets of edges of these kinds."""
        edges, common = len(kinds.kinds), 6 + numbers
        offsets = mostly_zero(edges, common), mostly_zero(edges), mostly_zero(edges), np.ones(edges)
        information = np.diag(np.repeat([1.0, 0.0], [6, numbers]))
        told = np.zeros(-(-edges // TOGETHER), dtype=np.uint8)
        return cls(information, np.zeros(common), *offsets, kinds.kinds, kinds.signs, np.ones(kinds.number), told)


class EdgeOffsets(NamedTuple):
    """Edges in view: their rows (g,) in the state, and the prior variances of their offsets.

    variance_px2 (g,) of what is an edge's own, kind_px2 (g,) of what it shares with its kind.
    """

    rows: Indices
    variance_px2: Array
    kind_px2: Array


class ExpectedOffsets(NamedTuple):
    """Offsets (g,) in px that the edges in view are known to have, and their variances (g,)."""

    px: Array
    variance_px2: Array


class LocalBiases(NamedTuple):
    """Information on the biases at a linearization point, with D as a twist (6,) of the camera there.

    information (6 + r, 6 + r) and vector (6 + r,) on D and the numbers, with the offsets of the edges in view and of
    their kinds not marginalized; cross (g, 6 + r), offset_information (g,) and offset_vector (g,) of those of the
    edges. kinds (g,) rows of `of_kinds`, -1 for none, and ties (g,) the information between an edge's offset and that
    of its kind, to which the edge adds the absolute value. of_kinds: what the prior and the edges out of view say.
    expected: offsets where D is 0.
    """

    information: Array
    vector: Array
    cross: Array
    offset_information: Array
    offset_vector: Array
    kinds: Indices
    ties: Array
    of_kinds: KindSums
    expected: ExpectedOffsets


class Known(NamedTuple):
    """Information (6 + r, 6 + r) on D and the numbers with all offsets marginalized, and the sums of the kinds."""

    information: Array
    of_kinds: KindSums


class BiasesInView(NamedTuple):
    """The state of the biases, what is known of it, and the edges in view."""

    state: BiasState
    known: Known
    edges: EdgeOffsets


FRAME_SUMS = named_tuple(FrameSums, "f1! f2! f1! f2! f1! f2! f1!")
KIND_SUMS = named_tuple(KindSums, "f1! f2! f1!")
BIAS_STATE = named_tuple(BiasState, "f2! f1! f2! f1! f1! f1! i1! f1! f1! u1!")
EDGE_OFFSETS = named_tuple(EdgeOffsets, "i1! f1! f1!")
EXPECTED_OFFSETS = named_tuple(ExpectedOffsets, "f1! f1!")
LOCAL_BIASES = named_tuple(
    LocalBiases, "f2! f1! f2! f1! f1! i1! f1! kinds expected", kinds=KIND_SUMS, expected=EXPECTED_OFFSETS
)
KNOWN = named_tuple(Known, "f2! kinds", kinds=KIND_SUMS)
BIASES_IN_VIEW = named_tuple(BiasesInView, "state known edges", state=BIAS_STATE, known=KNOWN, edges=EDGE_OFFSETS)


@compiled("state i0", inner=True, allocates=False, state=BIAS_STATE)
def told_of(state: BiasState, block: int) -> range:
    """The edges of a block of TOGETHER of which frames told; none if they told of none of them."""
    first = block * TOGETHER
    return range(first, min(first + TOGETHER, len(state.offset_information)) if state.told[block] else first)
