"""The vehicle's filter: IMU samples and measurements in any order, each applied at its own stamp, even when delayed."""

from bisect import bisect_left
from math import isfinite

import numpy as np
from scipy.special import chdtri

from uavbench.tracker.fusion.camera_on_body import FixedMount, KnownMount
from uavbench.tracker.fusion.events import Carried, Checkpoint, Key, Nominal, PredictedCamera, Sample, Since, Verdict
from uavbench.tracker.fusion.kernels import (
    innovation_covariance,
    normalized_innovation,
    propagate,
    propagate_nominal,
    update,
)
from uavbench.tracker.fusion.measurements import CameraPose, Innovation, Measurement, deviation
from uavbench.tracker.fusion.state import ERROR, Estimate, FusionConfig
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Array, Pose

IMU_RANK = 0
"""Rank of an IMU sample, before the measurements of equal stamp."""
DOUBT = 2.0
"""Inflation factor of the standard deviations of the pose for each rejected camera pose beyond `doubt_after`."""
REJECTED = 2.0
"""Normalized innovation, in multiples of its gate, from which a measurement is rejected and not only weighted down."""


class VehicleFilter:
    """Error-state Kalman filter of pose, velocity, IMU biases and the slow error of the camera's poses.

    Events are kept for `history_s` with the state after each. A delayed event is inserted at its stamp, and all later
    ones are replayed, so that the state is bit-identical to that without the delay. IMU readings are interpolated
    linearly between samples; a measurement is applied once an IMU sample at or after its stamp has arrived. mount: the
    fixed pose `cam_from_body`, or what is known of one that moves.
    """

    def __init__(self, config: FusionConfig, mount: Pose | KnownMount, initial: Estimate) -> None:
        prepare(__name__)
        self.config = config
        self._mount = FixedMount(mount) if isinstance(mount, Pose) else mount
        self._densities = config.densities
        self._history_ns = round(config.history_s * 1e9)
        self._gates = {m: float(chdtri(m, 1.0 - config.gate)) for m in range(1, 7)}
        P = np.eye(ERROR)
        P[:15, :15] = initial.covariance
        self._arrivals = 0
        self._keys: list[Key] = []
        self._events: list[Sample | Measurement] = []
        self._done: list[Checkpoint] = []
        self._base = Checkpoint(initial.stamp_ns, initial.pack(), P, None, 0, None)
        self._past: list[Verdict] = []

    def imu(self, stamp_ns: int, gyro_rad_s: Array, accel_m_s2: Array) -> None:
        """Process an IMU sample; ValueError when it is not finite."""
        reading = np.concatenate((gyro_rad_s, accel_m_s2), dtype=np.float64)
        if len(gyro_rad_s) != 3 or reading.shape != (6,) or not all(map(isfinite, reading.tolist())):
            raise ValueError(f"IMU sample at {stamp_ns}: two finite vectors (3,) are needed")
        self._put(Key(stamp_ns, IMU_RANK, 0), Sample(reading))

    def camera(self, stamp_ns: int, result: TrackResult) -> None:
        """Process a tracker's result; ignored unless its status is `ok` and it has a covariance."""
        if result.status != "ok" or result.cam_from_world is None or result.covariance is None:
            return
        try:
            camera = self._mount.at(stamp_ns)
            pose = CameraPose.claimed(stamp_ns, result.cam_from_world, result.covariance, camera, self.config)
        except (ValueError, np.linalg.LinAlgError) as error:
            self._past.append(Verdict(stamp_ns, "CameraPose", None, None, str(error)))
            return
        self.take(pose)

    def take(self, measurement: Measurement) -> None:
        """Process a measurement; one that is too late or far beyond its gate is rejected (see `verdicts`)."""
        self._arrivals += 1
        self._put(Key(measurement.stamp_ns, measurement.rank, self._arrivals), measurement)

    @property
    def verdicts(self) -> list[Verdict]:
        """Outcome of every measurement so far, in the order of their stamps."""
        told = self._past + [c.verdict for c in self._done if c.verdict is not None]
        return sorted(told, key=lambda verdict: verdict.stamp_ns)

    def estimate(self, stamp_ns: int | None = None) -> Estimate:
        """State at a stamp (default: the last IMU sample's), propagated with the last reading beyond that.

        ValueError for a stamp older than the history.
        """
        last = self._last
        at = last.stamp_ns if stamp_ns is None else stamp_ns
        state, P, sample = self._at(at)
        return Estimate(
            stamp_ns=at,
            world_from_body=Pose(state[6:15].reshape(3, 3), state[0:3]),
            velocity_m_s=state[3:6],
            accel_bias_m_s2=state[15:18],
            gyro_bias_rad_s=state[18:21],
            angular_velocity_rad_s=None if sample is None else sample.gyro - state[18:21],
            covariance=P[:15, :15],
        )

    def nominal(self, stamp_ns: int) -> Nominal:
        """Nominal state (27,) at a stamp, and angular velocity (3,) in the body, without their covariance.

        Intended for a controller, which runs at its own rate. ValueError as `estimate`, and before the first IMU
        sample.
        """
        before, sample = self._since(stamp_ns)
        if sample is None:
            raise ValueError(f"no IMU sample yet: no angular velocity is known at {stamp_ns}")
        state = before.state
        dt = (stamp_ns - before.stamp_ns) * 1e-9
        if dt > 0:
            first = before.sample or sample
            state = propagate_nominal(state, first.reading, sample.reading, dt, self._densities)
        return Nominal(state, sample.gyro - state[18:21])

    def covariance(self, stamp_ns: int) -> Array:
        """Covariance (15, 15) of the estimate at a stamp; ValueError as `estimate`."""
        return self._at(stamp_ns)[1][:15, :15]

    def predict_camera(self, stamp_ns: int) -> PredictedCamera:
        """Predicted `cam_from_world` and the covariance (6, 6) of its twist: a prior for a tracker."""
        state, P, _ = self._at(stamp_ns)
        camera = self._mount.at(stamp_ns)
        pose = camera.cam_from_body @ Pose(state[6:15].reshape(3, 3), state[0:3]).inverse()
        H = deviation(pose, camera.cam_from_body, state).H[:, :15]
        return PredictedCamera(pose, H @ P[:15, :15] @ H.T + camera.white + camera.constant)

    @property
    def _last(self) -> Checkpoint:
        return self._done[-1] if self._done else self._base

    def _put(self, key: Key, event: "Sample | Measurement") -> None:
        """Insert an event at its place in the history, and process what can be processed."""
        if key.stamp_ns < self._base.stamp_ns:
            if key.rank != IMU_RANK:
                self._past.append(Verdict(key.stamp_ns, type(event).__name__, None, None, "older than the history"))
            return
        place = bisect_left(self._keys, key) if self._keys and key <= self._keys[-1] else len(self._keys)
        if key.rank == IMU_RANK and place < len(self._keys) and self._keys[place] == key:
            return  # the same sample twice
        self._keys.insert(place, key)
        self._events.insert(place, event)
        if key.rank == IMU_RANK:  # measurements after the previous sample used another interpolation
            while place and self._keys[place - 1].rank != IMU_RANK:
                place -= 1
        del self._done[place:]
        self._go_on()
        self._forget()

    def _go_on(self) -> None:
        """Process all events up to the stamp of the last IMU sample, that included."""
        keys, done = self._keys, self._done
        until_ns = next((key.stamp_ns for key in reversed(keys) if key.rank == IMU_RANK), self._base.stamp_ns - 1)
        while len(done) < len(keys) and keys[len(done)].stamp_ns <= until_ns:
            place, before = len(done), self._last
            event, stamp_ns = self._events[place], keys[place].stamp_ns
            if isinstance(event, Sample):
                state, P, _ = self._carried(before, stamp_ns, event)
                done.append(Checkpoint(stamp_ns, state, P, event, before.refused, None))
            else:
                state, P, sample = self._carried(before, stamp_ns, self._reading(place))
                done.append(self._measured(event, Checkpoint(stamp_ns, state, P, sample, before.refused, None)))

    def _reading(self, place: int) -> Sample:
        """IMU reading at a measurement's stamp, interpolated linearly between the adjacent samples."""
        key = self._keys[place]
        if self._last.sample is not None and self._last.stamp_ns == key.stamp_ns:
            return self._last.sample
        after = next(i for i in range(place + 1, len(self._keys)) if self._keys[i].rank == IMU_RANK)
        later, last = self._events[after], self._last
        assert isinstance(later, Sample)
        if last.sample is None:
            return later
        span = self._keys[after].stamp_ns - last.stamp_ns
        share = (key.stamp_ns - last.stamp_ns) / span if span else 0.0
        return Sample(last.sample.reading + share * (later.reading - last.sample.reading))

    def _carried(self, before: Checkpoint, stamp_ns: int, reading: Sample) -> Carried:
        """State and covariance propagated to a stamp with the mean of the readings at both ends."""
        dt = (stamp_ns - before.stamp_ns) * 1e-9
        if dt <= 0:
            return Carried(before.state, before.P, reading)
        first = before.sample or reading
        state, P = propagate(before.state, before.P, first.reading, reading.reading, dt, self._densities)
        return Carried(state, P, reading)

    def _measured(self, event: Measurement, at: Checkpoint) -> Checkpoint:
        """State after a measurement, updated unless it is far beyond its gate, and the verdict."""
        assert at.sample is not None
        kind, camera = type(event).__name__, isinstance(event, CameraPose)
        found = event.innovation(at.state, at.sample.gyro - at.state[18:21])
        if found is None:
            return self._verdict(at, Verdict(at.stamp_ns, kind, None, None, "the state cannot predict it"), at.refused)
        m, P = len(found.residual), at.P
        limit = REJECTED**2 * self._gates[m]
        d2 = normalized_innovation(P, found.residual, found.H, found.noise)
        if camera and at.refused >= self.config.doubt_after and not d2 <= limit:
            P = self._doubted(P)
            d2 = normalized_innovation(P, found.residual, found.H, found.noise)
        if not d2 <= limit:
            why = f"far beyond the gate: {d2:.1f} > {limit:.1f}"
            at = Checkpoint(at.stamp_ns, at.state, P, at.sample, at.refused, None)
            return self._verdict(at, Verdict(at.stamp_ns, kind, d2, m, why), at.refused + camera)
        noise = found.noise if d2 <= self._gates[m] else _weighted_down(P, found, np.sqrt(d2 / self._gates[m]))
        state, P = update(at.state, P, found.residual, found.H, noise)
        at = Checkpoint(at.stamp_ns, state, P, at.sample, at.refused, None)
        return self._verdict(at, Verdict(at.stamp_ns, kind, d2, m), 0 if camera else at.refused)

    @staticmethod
    def _doubted(P: Array) -> Array:
        """Covariance with inflated standard deviations of position, velocity and attitude."""
        scale = np.ones(ERROR)
        scale[:9] = DOUBT
        return np.asarray(P * np.outer(scale, scale))

    @staticmethod
    def _verdict(at: Checkpoint, verdict: Verdict, refused: int) -> Checkpoint:
        return Checkpoint(at.stamp_ns, at.state, at.P, at.sample, refused, verdict)

    def _at(self, stamp_ns: int) -> Carried:
        """State, covariance and reading at a stamp."""
        before, sample = self._since(stamp_ns)
        return Carried(before.state, before.P, None) if sample is None else self._carried(before, stamp_ns, sample)

    def _since(self, stamp_ns: int) -> Since:
        """Event and reading from which the state at a stamp follows; ValueError as `estimate`."""
        last = self._last
        if stamp_ns >= last.stamp_ns:
            if last.sample is None and stamp_ns > last.stamp_ns:
                raise ValueError(f"no IMU sample yet: nothing is known at {stamp_ns}")
            return Since(last, last.sample)
        place = bisect_left(self._keys, Key(stamp_ns + 1, IMU_RANK, 0)) - 1
        before = self._done[place] if place >= 0 else self._base
        if stamp_ns < self._base.stamp_ns:
            raise ValueError(f"{stamp_ns} is older than the history of {self.config.history_s} s")
        after = next(c for c in self._done[place + 1 :] if c.sample is not None)
        if before.sample is None or after.sample is None:
            return Since(before, after.sample or Sample(np.zeros(6)))
        share = (stamp_ns - before.stamp_ns) / max(after.stamp_ns - before.stamp_ns, 1)
        return Since(before, Sample(before.sample.reading + share * (after.sample.reading - before.sample.reading)))

    def _forget(self) -> None:
        """Drop events older than the history."""
        oldest = self._last.stamp_ns - self._history_ns
        if not self._keys or self._keys[0].stamp_ns >= oldest:
            return
        drop = min(bisect_left(self._keys, Key(oldest, IMU_RANK, 0)), len(self._done))
        if drop:
            self._past += [c.verdict for c in self._done[:drop] if c.verdict is not None]
            self._base = self._done[drop - 1]
            del self._keys[:drop], self._events[:drop], self._done[:drop]


def _weighted_down(P: Array, found: Innovation, beyond: float) -> Array:
    """Noise at which an innovation that is `beyond` times its gate moves the state as far as one at the gate.

    This is Huber's bounded influence (Karlgaard & Schaub 2007, Huber-based divided difference filtering).
    """
    return np.asarray(found.noise + (beyond - 1.0) * innovation_covariance(P, found.H, found.noise))
