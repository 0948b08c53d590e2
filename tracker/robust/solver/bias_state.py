"""State of the nuisance biases, and what a frame tells of them, as arrays for the compiled kernels.

With D the pose error of the patches as a twist in the world and b the offset of an edge in px, a frame whose pose is
determined by the patches observes the control points of that edge at J D + b. The information matrix is therefore an
arrowhead matrix: each offset is correlated with D alone, and can be marginalized separately.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class FrameSums(NamedTuple):
    """Normal equations of a frame, before the biases and the prior.

    For each edge in view: offset_weight (g,) sum of weights, offset_jacobian (g, 6) of weight times Jacobian,
    offset_residual (g,) of weight times residual. Over all control points: edge_information (6, 6), edge_vector (6,);
    over the patches: patch_information (6, 6), patch_vector (6,).
    """

    offset_weight: Array
    offset_jacobian: Array
    offset_residual: Array
    edge_information: Array
    edge_vector: Array
    patch_information: Array
    patch_vector: Array


class BiasState(NamedTuple):
    """Information on D and on the offsets of all edges (e,).

    information (6, 6) and vector (6,) on D; cross (e, 6) information between D and an offset; offset_information (e,)
    and offset_vector (e,) on the offset itself, offset_prior (e,) its prior information.
    """

    information: Array
    vector: Array
    cross: Array
    offset_information: Array
    offset_vector: Array
    offset_prior: Array

    @classmethod
    def unknown(cls, edges: int) -> "BiasState":
        """Unit information on D, and none on the offsets of this many edges."""
        offsets = np.zeros((edges, 6)), np.zeros(edges), np.zeros(edges), np.ones(edges)
        return cls(np.eye(6), np.zeros(6), *offsets)


class EdgeOffsets(NamedTuple):
    """Edges in view: their rows (g,) in the state, and the prior variance_px2 (g,) of their offsets."""

    rows: Indices
    variance_px2: Array


class LocalBiases(NamedTuple):
    """Information on the biases at a linearization point, with D as a twist (6,) of the camera there.

    information (6, 6) and vector (6,) on D, with the offsets of the edges in view not marginalized; cross (g, 6),
    offset_information (g,) and offset_vector (g,) of those.
    """

    information: Array
    vector: Array
    cross: Array
    offset_information: Array
    offset_vector: Array


FRAME_SUMS = named_tuple(FrameSums, "f1! f2! f1! f2! f1! f2! f1!")
BIAS_STATE = named_tuple(BiasState, "f2! f1! f2! f1! f1! f1!")
EDGE_OFFSETS = named_tuple(EdgeOffsets, "i1! f1!")
LOCAL_BIASES = named_tuple(LocalBiases, "f2! f1! f2! f1! f1!")
