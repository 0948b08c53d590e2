"""Three-vectors and 3 x 3 matrices as tuples, for the compiled inner loop of a flight.

Tuples compile several times faster than arrays of fixed size and allocate nothing; for arrays of rotations there is
`pose`.
"""

from math import sqrt

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]


@compiled
def vector(a: Array) -> Vector:
    """The three numbers of an array (3,)."""
    return a[0], a[1], a[2]


@compiled
def matrix(a: Array) -> Matrix:
    """The rows of an array (3, 3)."""
    return (a[0, 0], a[0, 1], a[0, 2]), (a[1, 0], a[1, 1], a[1, 2]), (a[2, 0], a[2, 1], a[2, 2])


@compiled
def add(a: Vector, b: Vector) -> Vector:
    """The sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def subtract(a: Vector, b: Vector) -> Vector:
    """The difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def scale(s: float, a: Vector) -> Vector:
    """The multiple s a."""
    return s * a[0], s * a[1], s * a[2]


@compiled
def multiply(a: Vector, b: Vector) -> Vector:
    """The product of each pair of components."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@compiled
def dot(a: Vector, b: Vector) -> float:
    """The inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """The cross product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def length(a: Vector) -> float:
    """The Euclidean norm."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@compiled
def rotate(R: Matrix, v: Vector) -> Vector:
    """The product R v."""
    return dot(R[0], v), dot(R[1], v), dot(R[2], v)


@compiled
def transpose(R: Matrix) -> Matrix:
    """The transpose; of a rotation, its inverse."""
    return (R[0][0], R[1][0], R[2][0]), (R[0][1], R[1][1], R[2][1]), (R[0][2], R[1][2], R[2][2])


@compiled
def rotation(q: Array) -> Matrix:
    """Rotation matrix of a unit quaternion wxyz (4,)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
