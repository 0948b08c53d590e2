"""The environment for learners: Gymnasium's own checks, the same flight twice, what is rewarded, and how it ends."""

import itertools
import warnings
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.bench.small_suites import FLOWN
from tests.bench.test_closed_loop import Watching, box
from tests.bench.test_gimballed_flight import gimballed
from uavbench.bench.closed_loop.latency import Constant
from uavbench.bench.closed_loop.spec import LoopSpec, Pilot
from uavbench.bench.closed_loop.trackers import GroundTruth
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.errors import UserError

gymnasium = pytest.importorskip("gymnasium", reason="the extra uavbench[gym]")
from gymnasium.utils.env_checker import check_env  # noqa: E402

from uavbench.bench.closed_loop.eye import eye  # noqa: E402
from uavbench.bench.learning.environment import CRASH_REWARD, NAME, InspectionEnv  # noqa: E402

SUITE = FLOWN.replace("duration_s = 0.3", "duration_s = 2.0")


@pytest.fixture(scope="module")
def suite(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("env") / "few.toml"
    path.write_text(SUITE)
    return path


@pytest.fixture(scope="module")
def env(suite):
    made = InspectionEnv.of_suite(str(suite), "truth")
    yield made
    made.close()


def towards_the_plan(observed):
    away = observed["planned"] - observed["estimate"][[0, 1, 2, 0]]
    return np.clip(np.append(away[:3] / 0.5, 0.0), -1, 1)


def test_gymnasium_finds_nothing_wrong(env):
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        check_env(env, skip_render_check=True)


def test_a_seed_gives_the_same_flight_and_another_one_another(env):
    def flown(seed):
        observed, _ = env.reset(seed=seed)
        out = [observed]
        for _ in range(4):
            observed, _, _, _, _ = env.step(towards_the_plan(observed))
            out.append(observed)
        return out

    one, two, other = flown(5), flown(5), flown(6)
    for a, b in zip(one, two, strict=True):
        assert all(np.array_equal(a[key], b[key]) for key in a)
    assert not np.array_equal(one[-1]["estimate"], other[-1]["estimate"])


def test_an_agent_that_follows_the_plan_sees_the_surface_and_comes_to_the_end(env):
    observed, about = env.reset(seed=1)
    seen, frames, over = about["coverage"], 1, False
    while not over:
        observed, reward, failed, over, about = env.step(towards_the_plan(observed))
        assert not failed
        assert 0 <= reward == pytest.approx(about["coverage"] - seen)
        seen, frames = about["coverage"], frames + 1
    assert seen > 0.1
    assert 25 <= frames <= 31  # 2 s at 15 Hz
    assert np.linalg.norm(observed["estimate"][:3] - observed["planned"][:3]) < 0.2


@pytest.mark.parametrize("rate_hz", [4.0, 40.0])
def test_an_imu_slower_than_the_camera_is_observed_too(tmp_path, rate_hz):
    """A frame without a new reading shows the one before it."""
    (tmp_path / "slow.toml").write_text(SUITE.replace('{ kind = "imu" }', f'{{ kind = "imu", rate_hz = {rate_hz} }}'))
    made = InspectionEnv.of_suite(str(tmp_path / "slow.toml"), "truth")
    observed, _ = made.reset(seed=1)
    seen = [observed]
    for _ in range(5):
        observed, _, failed, over, _ = made.step(towards_the_plan(observed))
        assert not (failed or over)
        seen.append(observed)
    made.close()
    assert all(made.observation_space.contains(one) for one in seen)
    different = {one["imu"].tobytes() for one in seen}
    assert len(different) == (2 if rate_hz == 4.0 else len(seen))  # readings at 0 and 0.25 s, frames until 0.33 s


def test_an_agent_that_dives_is_told_of_its_crash(env):
    env.reset(seed=1)
    for _ in range(31):
        _, reward, failed, over, about = env.step(np.array([0.0, 0.0, -1.0, 0.0]))
        if failed or over:
            break
    assert failed and reward == CRASH_REWARD
    assert about["status"] == "crashed" and "floor" in about["why"]


def test_a_fault_ends_an_episode_where_the_loop_says_so():
    """As a crash does, by reward and termination."""
    loop = LoopSpec(estimator="truth", on_fault="end")
    tracker = Watching(lambda stamp_ns: 1 / 0 if stamp_ns > 0.1e9 else TrackResult(status="lost"))
    made = InspectionEnv(box(), Pilot(label="it", tracker=tracker, rate_hz=15.0, loop=loop))
    made.reset(seed=1)
    told = [made.step(np.zeros(4))[1:] for _ in range(2)]
    made.close()
    assert [(failed, over) for _, failed, over, _ in told] == [(False, False), (True, False)]
    assert told[0][0] >= 0 and told[1][0] == CRASH_REWARD
    assert told[1][3]["status"] == "stopped" and "division by zero" in told[1][3]["why"]


def test_a_gimballed_camera_inspects_too_and_the_estimate_is_that_of_the_body():
    loop = LoopSpec(latency=Constant(0.0), coverage_px_m=20.0)
    made = InspectionEnv(gimballed(), Pilot(label="it", tracker=GroundTruth(), rate_hz=15.0, loop=loop))
    observed, about = made.reset(seed=1)
    for _ in range(10):
        observed, _, failed, _, about = made.step(towards_the_plan(observed))
        assert not failed
    assert about["coverage"] > 0.1
    true_m = made._loop.simulation.qpos[:3]
    assert np.linalg.norm(observed["estimate"][:3] - true_m) < 0.01
    made.close()


@pytest.mark.parametrize("action", [np.full(4, np.nan), np.zeros(3), np.zeros((1, 4)), np.array([0, 0, np.inf, 0])])
def test_an_action_that_is_none_is_refused(env, action):
    env.reset(seed=1)
    with pytest.raises(UserError, match="four numbers from -1 to 1"):
        env.step(action)


def withheld(image, first):
    """The images of a camera, none for the first so many."""
    frames = itertools.count()
    return lambda stamp_ns: None if next(frames) < first else image(stamp_ns)


@pytest.mark.parametrize("first", [2, 1000])
def test_an_episode_begins_with_the_first_frame_that_comes(suite, monkeypatch, first):
    made = InspectionEnv.of_suite(str(suite), "truth")

    @contextmanager
    def late_eye(*given):
        with eye(*given) as source:
            yield replace(source, image=withheld(source.image, first))

    monkeypatch.setattr("uavbench.bench.learning.environment.eye", late_eye)
    if first < 30:
        observed, _ = made.reset(seed=1)
        assert observed["image"].any()
    else:
        with pytest.raises(UserError, match="before the camera gives a frame"):
            made.reset(seed=1)
    made.close()


def test_it_is_made_by_name_and_its_mistakes_are_told(suite):
    made = gymnasium.make(NAME, suite=str(suite), tracker="hold", render_mode="rgb_array")
    observed, _ = made.reset(seed=2)
    assert np.array_equal(made.render(), observed["image"][..., ::-1])
    made.close()
    with pytest.raises(UserError, match="robots"):
        InspectionEnv.of_suite(str(suite), "robots")
    with pytest.raises(UserError, match=r"unknown loop 'late' \(valid: '', the only one\)"):
        InspectionEnv.of_suite(str(suite), "truth", "late")
    with pytest.raises(UserError, match=r"tiny has no table \[loop\]"):
        InspectionEnv.of_suite("tiny", "lsd")
