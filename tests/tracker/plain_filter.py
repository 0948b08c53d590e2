"""The vehicle's filter once more, from the equations of Sola (2017) alone: dense matrices, small steps, no shortcut.

It shares no code with `uavbench.tracker.fusion`: rotations and twists are scipy's matrix exponentials and logarithms,
the transition is integrated over short steps with its noise (Van Loan 1978), Jacobians are central differences, and
every event is processed in the order of the stamps. A camera pose is the true one times exp(slow + white error).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, logm

STEPS = 2
"""Steps between two events, at whose middle the attitude of the transition is taken."""
DIFFERENCE = 1e-6
"""Step of the central differences, in m and rad."""
GRAVITY = np.array([0.0, 0.0, -9.80665])


def cross_matrix(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def twist(T):
    """Translation and rotation part (6,) of the logarithm of a rigid transform (4, 4)."""
    log = np.real(logm(T))
    return np.array([*log[:3, 3], log[2, 1], log[0, 2], log[1, 0]])


@dataclass
class State:
    """Nominal state, and the covariance P (21, 21) of position, velocity, attitude, biases of force and rate, slow."""

    p: np.ndarray
    v: np.ndarray
    R: np.ndarray
    force_bias: np.ndarray
    rate_bias: np.ndarray
    slow: np.ndarray
    P: np.ndarray

    def with_error(self, e):
        """The true state of this error (eq. 2 of table 3: the attitude's is in the body)."""
        R = self.R @ expm(cross_matrix(e[6:9]))
        return State(self.p + e[0:3], self.v + e[3:6], R, self.force_bias + e[9:12], self.rate_bias + e[12:15],
                     self.slow + e[15:21], self.P)  # fmt: skip


@dataclass
class PlainFilter:
    """A state; densities of white noise of force and rate and of the walks of their biases; time constant of the slow
    error; squared innovation at the gate, beyond which an update is weighted down (Huber).
    """

    state: State
    white_force: float
    white_rate: float
    walk_force: float
    walk_rate: float
    slow_s: float
    gate: float

    def propagate(self, rate, force, seconds):
        """Motion (eq. 237) and error (eq. 238) under constant readings."""
        s, dt = self.state, seconds / STEPS
        w, f = rate - s.rate_bias, force - s.force_bias
        for _ in range(STEPS):
            half = expm(cross_matrix(w * dt / 2))
            accelerations = [s.R @ turn @ f + GRAVITY for turn in (np.eye(3), half, half @ half)]  # Simpson
            start, middle, end = accelerations
            p = s.p + s.v * dt + dt * dt / 6 * (start + 2 * middle)
            v = s.v + dt / 6 * (start + 4 * middle + end)
            F, Q = np.zeros((21, 21)), np.zeros((21, 21))
            R = s.R @ half
            F[0:3, 3:6] = np.eye(3)
            F[3:6, 6:9], F[3:6, 9:12] = -R @ cross_matrix(f), -R
            F[6:9, 6:9], F[6:9, 12:15] = -cross_matrix(w), -np.eye(3)
            F[15:, 15:] = -np.eye(6) / self.slow_s
            for k, density in ((3, self.white_force), (6, self.white_rate), (9, self.walk_force), (12, self.walk_rate)):
                Q[k : k + 3, k : k + 3] = density**2 * np.eye(3)
            Q[15:, 15:] = 2.0 / self.slow_s * np.eye(6)
            both = expm(np.block([[-F, Q], [np.zeros((21, 21)), F.T]]) * dt)
            transition = both[21:, 21:].T
            P = transition @ (s.P @ transition.T) + transition @ both[:21, 21:]
            slow = s.slow * np.exp(-dt / self.slow_s)
            s = State(p, v, s.R @ half @ half, s.force_bias, s.rate_bias, slow, 0.5 * (P + P.T))
        self.state = s

    def see(self, cam_from_world, claimed, cam_from_body, slow_share, bias):
        """Update by a camera pose (4, 4) with a claimed covariance (6, 6), and how far it is beyond the gate.

        bias (6,): standard deviations of what images cannot show.
        """
        L = np.linalg.cholesky(slow_share * claimed + np.diag(bias**2))

        def residual(e):
            true = self.state.with_error(e)
            world_from_body = np.eye(4)
            world_from_body[:3, :3], world_from_body[:3, 3] = true.R, true.p
            error = twist(cam_from_body @ np.linalg.inv(world_from_body) @ np.linalg.inv(cam_from_world))
            return L @ true.slow - error

        steps = DIFFERENCE * np.eye(21)
        H = -np.column_stack([(residual(e) - residual(-e)) / (2 * DIFFERENCE) for e in steps])
        s = self.state
        innovation, S = residual(np.zeros(21)), H @ s.P @ H.T + (1.0 - slow_share) * claimed
        beyond = np.sqrt(innovation @ np.linalg.inv(S) @ innovation / self.gate)
        K = s.P @ H.T @ np.linalg.inv(max(beyond, 1.0) * S)  # (eq. 273), with a noise that scales S beyond the gate
        error = K @ innovation
        G = np.eye(21)
        G[6:9, 6:9] -= cross_matrix(error[6:9] / 2)  # (eq. 287)
        self.state = s.with_error(error)
        self.state.P = G @ (np.eye(21) - K @ H) @ s.P @ G.T
        return beyond
