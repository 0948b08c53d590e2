"""A program that lies in flight: what the gate, the record and the measures say of it, and what the vehicle does."""

import csv
import sys

import numpy as np
import pytest

from uavbench.bench.closed_loop.fly import fly
from uavbench.bench.closed_loop.latency import Constant
from uavbench.bench.closed_loop.spec import LoopSpec, Pilot
from uavbench.bench.closed_loop.trackers import GroundTruth
from uavbench.bench.external.program import External
from uavbench.reports.closed_loop.measures import measure_flight
from uavbench.scenes.spec import CameraSpec, SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.world.studio import Studio
from uavbench.trajectories.paths.around import Hover
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.sensors.imu import ImuBmi088
from uavbench.trajectories.simulation.flight import FlightSpec

HONEST_S = 10.0
"""The program says the truth up to this time, and is half a metre too high from then on."""
TOO_HIGH = Pose(np.eye(3), np.array([0.0, 0.0, 0.5]))
SIGMAS = np.array([0.001] * 3 + [np.radians(0.05)] * 3)
"""What it claims of every pose, in m and rad; `truth` claims the same."""

PROGRAM = """
import sys
answers = dict(line.strip().split(",", 1) for line in open(sys.argv[1]))
print("ready", flush=True)
for line in sys.stdin.buffer:
    kind, stamp, *words = line.decode().strip().split(",")
    if kind == "frame":
        width, height, channels = map(int, words)
        sys.stdin.buffer.read(width * height * channels)
        print(stamp + "," + answers[stamp], flush=True)
"""


def spec():
    return SequenceSpec(
        name="box-s1",
        seed=1,
        structure=Box(),
        environment=Studio(),
        flight=FlightSpec(path=Hover(duration_s=12.5)),
        camera=CameraSpec(width=80, height=60, horizontal_fov_deg=65.0),
        sensors=(ImuBmi088(),),
    )


def flown(tracker):
    flight, loop = spec(), LoopSpec(latency=Constant(0.0), corridor_m=0.3)
    return fly(flight, Pilot(label="it", tracker=tracker, rate_hz=flight.rate_hz, loop=loop))


@pytest.fixture(scope="module")
def deceived(tmp_path_factory):
    """The flight of a program that knows what the truth was in the same flight on `truth`."""
    folder = tmp_path_factory.mktemp("liar")
    honest = flown(GroundTruth())
    cam_from_body = spec().mount.cam_from_body
    covariance = np.diag(SIGMAS**2)[np.triu_indices(6)].tolist()
    with (folder / "answers.csv").open("w", newline="") as handle:
        for i, stamp in enumerate(honest.results.stamps_ns.tolist()):
            body = honest.groundtruth.pose(i)
            pose = cam_from_body @ (TOO_HIGH @ body if stamp > HONEST_S * 1e9 else body).inverse()
            numbers = [*pose.translation.tolist(), *pose.quaternion_wxyz.tolist(), *covariance]
            csv.writer(handle, lineterminator="\n").writerow([stamp, "ok", *map(repr, numbers)])
    (folder / "liar.py").write_text(PROGRAM)
    return flown(External(command=(sys.executable, str(folder / "liar.py"), str(folder / "answers.csv"))))


def test_lies_are_rejected_until_the_filter_doubts_itself(deceived):
    """Innovations alone cannot tell a tracker that lies on from a filter that is wrong: in the end the poses win."""
    first_lie = int(deceived.results.stamps_ns[deceived.results.stamps_ns > HONEST_S * 1e9][0])
    whys = {int(stamp): why for stamp, kind, _, _, why in deceived.innovations if kind == "CameraPose"}
    assert not any(why for stamp, why in whys.items() if stamp < first_lie)
    lies = [why for stamp, why in whys.items() if stamp >= first_lie]
    refused = next(i for i, why in enumerate(lies) if not why)  # the number of those before the first that is taken
    assert refused >= LoopSpec().filter.doubt_after
    assert all("far beyond the gate" in why for why in lies[:refused])
    score = measure_flight(deceived)
    assert score.refused_share == pytest.approx(sum(map(bool, whys.values())) / len(whys))


def test_the_imu_holds_the_vehicle_while_lies_are_rejected(deceived):
    path = deceived.path
    error = np.linalg.norm(path.group("true_p_m") - path.group("estimated_p_m"), axis=1)
    seconds = path.stamps_ns / 1e9
    assert error[(seconds > 1.0) & (seconds <= HONEST_S)].max() < 0.02
    assert error[(seconds > HONEST_S) & (seconds < HONEST_S + LoopSpec().filter.doubt_after / 15.0)].max() < 0.05
    assert error[seconds > HONEST_S].max() > 0.4


def test_a_lie_is_no_fault_but_false_from_its_frame_on_and_the_crash_is_counted_from_there(deceived):
    score = measure_flight(deceived)
    assert deceived.record["errors"] == []
    assert (score.status, score.success, score.ok_share) == ("crashed", False, 1.0)
    assert "floor" in score.why
    assert HONEST_S < score.first_false_s < HONEST_S + 0.1
    assert score.false_to_crash_s == pytest.approx(score.ended_s - score.first_false_s)
    assert 0.3 < score.false_to_crash_s < 4.0
