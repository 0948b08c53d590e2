"""Compiled propagation and update of the error-state Kalman filter (Sola 2017, sections 5 and 6).

A state is an array (27,): position, velocity, rotation by rows, accelerometer bias, gyroscope bias, camera bias; `P`
(21, 21) the covariance of its error. Sums keep their order, so a replay gives the same bits.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import cholesky, combination, so3_exp, so3_left_jacobian, solved
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array


@compiled("f1", inner=True)
def second_integral(phi: Array) -> Array:
    """Integral of `so3_left_jacobian`: displacement per constant specific force and dt^2 (Bloesch et al. 2012)."""
    a2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    if a2 < 1e-4:
        return combination(phi, 0.5, 1.0 / 6.0 - a2 / 120.0, 1.0 / 24.0 - a2 / 720.0)
    a = math.sqrt(a2)
    return combination(phi, 0.5, (a - math.sin(a)) / (a2 * a), (0.5 * a2 + math.cos(a) - 1.0) / (a2 * a2))


@compiled("f2 f2", inner=True)
def product(A: Array, B: Array) -> Array:
    """A @ B with sums in a fixed order."""
    n, m = A.shape[0], B.shape[1]
    out = np.zeros((n, m))
    for i in range(n):
        for k in range(A.shape[1]):
            a = A[i, k]
            if a != 0.0:
                for j in range(m):
                    out[i, j] += a * B[k, j]
    return out


@compiled("f2 f1", inner=True)
def turned(A: Array, v: Array) -> Array:
    """A v for a matrix (3, 3)."""
    return np.array([
        A[0, 0] * v[0] + A[0, 1] * v[1] + A[0, 2] * v[2],
        A[1, 0] * v[0] + A[1, 1] * v[1] + A[1, 2] * v[2],
        A[2, 0] * v[0] + A[2, 1] * v[1] + A[2, 2] * v[2],
    ])  # fmt: skip


class Belief(NamedTuple):
    """A nominal state (27,) and the covariance P (21, 21) of its error."""

    state: Array
    P: Array


class Increments(NamedTuple):
    """Motion in the body over dt of constant readings.

    force (3,) in m/s^2 and angle phi (3,) in rad without biases; rotation E (3, 3), integrals G1, G2 (3, 3) of the
    rotation, and velocity a1 = G1 force and displacement a2 = G2 force (3,) per dt and dt^2.
    """

    force: Array
    phi: Array
    E: Array
    G1: Array
    G2: Array
    a1: Array
    a2: Array


@compiled("f1 f1 f1 f0", inner=True)
def increments(state: Array, first: Array, last: Array, dt: float) -> Increments:
    """Motion in the body over dt seconds with the mean of the readings (6,) at both ends, rad/s and m/s^2."""
    mean = 0.5 * (first + last)
    force, phi = mean[3:6] - state[15:18], (mean[0:3] - state[18:21]) * dt
    E, G1, G2 = so3_exp(phi), so3_left_jacobian(phi), second_integral(phi)
    return Increments(force, phi, E, G1, G2, turned(G1, force), turned(G2, force))


@compiled("f1 f2 f1 f1 f0 f1", inner=True)
def moved(state: Array, E: Array, a1: Array, a2: Array, dt: float, densities: Array) -> Array:
    """Nominal state (27,) after the increments E, a1, a2 of dt seconds (eq. 259)."""
    R = np.ascontiguousarray(state[6:15]).reshape(3, 3)
    out = state.copy()
    ra1, ra2 = turned(R, a1), turned(R, a2)
    for i in range(3):
        g = -densities[7] if i == 2 else 0.0
        out[i] = state[i] + state[3 + i] * dt + ra2[i] * dt * dt + 0.5 * g * dt * dt
        out[3 + i] = state[3 + i] + ra1[i] * dt + g * dt
    R_new = product(R, E)
    # one Newton step towards the nearest rotation keeps round-off from growing: R (3 I - R' R) / 2
    near = product(np.ascontiguousarray(R_new.T), R_new)
    correction = -0.5 * near
    for i in range(3):
        correction[i, i] += 1.5
    R_new = product(R_new, correction)
    for i in range(3):
        for j in range(3):
            out[6 + 3 * i + j] = R_new[i, j]
    decay = math.exp(-dt / densities[6])
    for i in range(21, 27):
        out[i] = state[i] * decay
    return out


@compiled("f1 f1 f1 f0 f1")
def propagate_nominal(state: Array, first: Array, last: Array, dt: float, densities: Array) -> Array:
    """Nominal state (27,) of `propagate` to the same bits, at a fraction of its cost."""
    step = increments(state, first, last, dt)
    return moved(state, step.E, step.a1, step.a2, dt, densities)


@compiled("f1 f2 f1 f1 f0 f1")
def propagate(state: Array, P: Array, first: Array, last: Array, dt: float, densities: Array) -> Belief:
    """State and covariance after dt seconds with the mean of the readings (6,) at both ends, rad/s and m/s^2.

    The nominal state (eq. 259) is integrated in closed form for constant rate and specific force in the body; the
    error's transition (eq. 269, 270) and noise (eq. 262 to 265, with the densities of continuous time) follow from it.
    """
    force, phi, E, G1, G2, a1, a2 = increments(state, first, last, dt)
    out = moved(state, E, a1, a2, dt, densities)
    R = np.ascontiguousarray(state[6:15]).reshape(3, 3)
    RG1, RG2 = product(R, G1), product(R, G2)
    decay = math.exp(-dt / densities[6])

    # Rows of the transition that differ from the identity: position, velocity, attitude, on 15 columns.
    F = np.zeros((9, 15))
    for i in range(9):
        F[i, i] = 1.0
    position_by_attitude = product(R, combination(a2, 0.0, 1.0, 0.0))
    velocity_by_attitude = product(R, combination(a1, 0.0, 1.0, 0.0))
    by_force = product(R, combination(force, 0.0, 1.0, 0.0))
    J = so3_left_jacobian(-phi)  # right Jacobian (eq. 143)
    for i in range(3):
        F[i, 3 + i] = dt
        for j in range(3):
            F[i, 6 + j] = -position_by_attitude[i, j] * dt * dt
            F[i, 9 + j] = -RG2[i, j] * dt * dt
            F[i, 12 + j] = by_force[i, j] * dt * dt * dt / 6.0
            F[3 + i, 6 + j] = -velocity_by_attitude[i, j] * dt
            F[3 + i, 9 + j] = -RG1[i, j] * dt
            F[3 + i, 12 + j] = by_force[i, j] * dt * dt / 2.0
            F[6 + i, 6 + j] = E[j, i]
            F[6 + i, 12 + j] = -J[i, j] * dt
    upper = product(F, np.ascontiguousarray(P[:15, :]))
    corner = product(np.ascontiguousarray(upper[:, :15]), np.ascontiguousarray(F.T))
    P_new = P.copy()
    for i in range(9):
        for j in range(9):
            P_new[i, j] = 0.5 * (corner[i, j] + corner[j, i])
        for j in range(9, 15):
            P_new[i, j] = P_new[j, i] = upper[i, j]
        for j in range(15, 21):
            P_new[i, j] = P_new[j, i] = upper[i, j] * decay
    for i in range(15, 21):
        for j in range(9, 15):
            P_new[i, j] = P_new[j, i] = P[i, j] * decay
        for j in range(15, 21):
            P_new[i, j] = P[i, j] * decay * decay
    white_a, white_g = densities[0] * densities[0], densities[1] * densities[1]
    fresh = 1.0 - decay * decay
    for i in range(3):
        P_new[i, i] += white_a * dt * dt * dt / 3.0
        P_new[i, 3 + i] += white_a * dt * dt / 2.0
        P_new[3 + i, i] += white_a * dt * dt / 2.0
        P_new[3 + i, 3 + i] += white_a * dt
        P_new[6 + i, 6 + i] += white_g * dt
        P_new[9 + i, 9 + i] += densities[2] * densities[2] * dt
        P_new[12 + i, 12 + i] += densities[3] * densities[3] * dt
        P_new[15 + i, 15 + i] += densities[4] * densities[4] * fresh
        P_new[18 + i, 18 + i] += densities[5] * densities[5] * fresh
    return Belief(out, P_new)


@compiled("f2")
def is_positive(P: Array) -> bool:
    """Whether a symmetric matrix and its trace are finite, and the matrix is positive definite."""
    trace = 0.0
    for i in range(P.shape[0]):
        trace += P[i, i]
        for j in range(P.shape[1]):
            if not math.isfinite(P[i, j]):
                return False
    return math.isfinite(trace) and cholesky(P, np.zeros(P.shape))


@compiled("f1 f2!", allocates=False)
def fill_jacobian(e: Array, J: Array) -> None:
    """Jacobian (6, 6) by d of log(exp(d) exp(e)), to first order in the twist e (6,): I - ad(e) / 2."""
    for i in range(6):
        for j in range(6):
            J[i, j] = 1.0 if i == j else 0.0
    for i, j in ((0, 0), (3, 3)):  # ad acts on (translation, rotation)
        J[i, j + 1], J[i + 1, j] = 0.5 * e[5], -0.5 * e[5]
        J[i, j + 2], J[i + 2, j] = -0.5 * e[4], 0.5 * e[4]
        J[i + 1, j + 2], J[i + 2, j + 1] = 0.5 * e[3], -0.5 * e[3]
    J[0, 4], J[1, 3] = 0.5 * e[2], -0.5 * e[2]
    J[0, 5], J[2, 3] = -0.5 * e[1], 0.5 * e[1]
    J[1, 5], J[2, 4] = 0.5 * e[0], -0.5 * e[0]


@compiled("f2 f2 f2")
def innovation_covariance(P: Array, H: Array, N: Array) -> Array:
    """Covariance (m, m) of the innovation of a measurement with Jacobian H (m, 21) and noise N (m, m)."""
    return product(product(H, P), np.ascontiguousarray(H.T)) + N


@compiled("f2 f1 f2 f2")
def normalized_innovation(P: Array, residual: Array, H: Array, N: Array) -> float:
    """Squared Mahalanobis distance of a residual (m,) with Jacobian H (m, 21) and noise N (m, m); NaN if singular."""
    S = innovation_covariance(P, H, N)
    L = np.zeros(S.shape)
    if not cholesky(S, L):
        return math.nan
    column = residual.copy().reshape(-1, 1)
    x = solved(L, column)
    total = 0.0
    for i in range(len(residual)):
        total += residual[i] * x[i, 0]
    return total


@compiled("f1 f2 f1 f2 f2")
def update(state: Array, P: Array, residual: Array, H: Array, N: Array) -> Belief:
    """State and covariance after a measurement (eq. 273 to 275, Joseph's form), error injected (282) and reset (285).

    residual (m,) is the measurement less its prediction, H (m, 21) its Jacobian by the error, N (m, m) its covariance.
    """
    HP = product(H, P)
    Ht = np.ascontiguousarray(H.T)
    S = product(HP, Ht) + N
    L = np.zeros(S.shape)
    cholesky(S, L)
    K = np.ascontiguousarray(solved(L, HP).T)
    error = product(K, residual.copy().reshape(-1, 1))[:, 0]
    A = -product(K, H)
    for i in range(A.shape[0]):
        A[i, i] += 1.0
    P_new = product(product(A, P), np.ascontiguousarray(A.T)) + product(product(K, N), np.ascontiguousarray(K.T))
    out = state.copy()
    for i in range(6):
        out[i] += error[i]
        out[15 + i] += error[9 + i]
        out[21 + i] += error[15 + i]
    R = product(np.ascontiguousarray(state[6:15]).reshape(3, 3), so3_exp(error[6:9]))
    for i in range(3):
        for j in range(3):
            out[6 + 3 * i + j] = R[i, j]
    # Reset: the attitude error is now expressed at the new attitude (eq. 287).
    G = combination(error[6:9], 1.0, -0.5, 0.0)
    rows = product(G, np.ascontiguousarray(P_new[6:9, :]))
    P_new[6:9, :] = rows
    columns = product(np.ascontiguousarray(P_new[:, 6:9]), np.ascontiguousarray(G.T))
    P_new[:, 6:9] = columns
    return Belief(out, 0.5 * (P_new + P_new.T))
