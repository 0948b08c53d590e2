"""A tracker that was started compiles nothing, whatever it is shown; two processes share the work."""

import fcntl
import json
import os
import subprocess
import sys
import tempfile
from itertools import islice

import numpy as np
import pytest

from tests.bench.process_trees import is_alive, wait_until
from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.registry import TRACKERS
from uavbench.trajectories.kernels import warm_up
from uavbench.trajectories.kernels.argument_types import argument_types
from uavbench.trajectories.kernels.compiled import KERNELS, compiled
from uavbench.trajectories.kernels.warm_up import in_order, kernels_of, prepare, queue_of, taken

FRAME_NS = 66_666_667
FLIGHT = """
import json
import sys
import numpy as np
from numba.core import event
from tests.tracker.synthetic import CAMERA, box
from uavbench.tracker.registry import TRACKERS

heard = []
class Listener(event.Listener):
    def on_start(self, event):
        heard.append(str(event.data["dispatcher"]))
    def on_end(self, event):
        pass

with np.load(sys.argv[1]) as flight:
    images, first = flight["images"], flight["first"]
from uavbench.trajectories.pose import Pose
event.register("numba:compile", Listener())
told = {}
for kind in sorted(TRACKERS):
    for grey in (False, True):
        run = TRACKERS[kind]().start(box(), CAMERA, Pose(first[:3, :3], first[:3, 3]), np.random.default_rng(0))
        heard.clear()
        lost = 0
        for k, image in enumerate(images):
            image = np.ascontiguousarray(image[..., 1]) if grey else image
            lost += run.track(image, k * 66_666_667).status == "lost"
        told[f"{kind} {grey}"] = [lost, *heard]
print(json.dumps(told))
"""

COLLECTED = """
import gc
import sys
import numpy as np
import uavbench as ub
from tests.tracker.synthetic import CAMERA, box
from uavbench.trajectories.pose import Pose

with np.load(sys.argv[1]) as flight:
    images, first = flight["images"], flight["first"]
run = ub.start("robust", box(), CAMERA, Pose(first[:3, :3], first[:3, 3]))
whole = []
gc.callbacks.append(lambda phase, about: whole.append(phase) if about["generation"] == 2 else None)
for k, image in enumerate(images):
    run.track(image, k * 66_666_667)
print(len(whole))
"""

LOOKED_UP = """
import sys
import numpy as np
import uavbench as ub
from numba.core.registry import CPUDispatcher
from tests.tracker.synthetic import CAMERA, box
from uavbench.trajectories.pose import Pose

with np.load(sys.argv[1]) as flight:
    images, first = flight["images"], flight["first"]
run = ub.start("robust", box(), CAMERA, Pose(first[:3, :3], first[:3, 3]))
known, unknown = CPUDispatcher.typeof_pyval, []
def heard(kernel, value):
    unknown.append(f"{kernel.py_func.__name__}: {type(value).__name__}")
    return known(kernel, value)
CPUDispatcher.typeof_pyval = heard
for k, image in enumerate(images):
    run.track(image, k * 66_666_667)
print(*unknown, sep="\\n")
"""


@pytest.fixture(scope="module")
def flight_file(tmp_path_factory):
    """Frames that are tracked, blank ones, and some from elsewhere, after which a tracker must find the box again."""
    poses, images = flown(16, seed=5)
    blank = np.full_like(images[0], 70)
    shown = [*images[:6], blank, blank, *images[12:], images[2]]
    path = tmp_path_factory.mktemp("flight") / "flight.npz"
    np.savez(path, images=np.array(shown), first=poses[0].matrix)
    return path


def test_no_frame_of_any_kind_compiles_anything(flight_file):
    code = [sys.executable, "-c", FLIGHT, str(flight_file)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run(code, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert set(told) == {f"{kind} {grey}" for kind in TRACKERS for grey in (False, True)}
    assert {run: heard for run, (_, *heard) in told.items() if heard} == {}
    assert told["robust False"][0] >= 2  # frames were lost, and so poses searched


def test_no_frame_waits_for_the_garbage_of_what_was_imported(flight_file):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    code = [sys.executable, "-c", COLLECTED, str(flight_file)]
    done = subprocess.run(code, capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "0\n"


def test_no_frame_waits_for_what_its_arguments_are_looked_up(flight_file):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    code = [sys.executable, "-c", LOOKED_UP, str(flight_file)]
    done = subprocess.run(code, capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "\n"


def test_a_started_tracker_has_all_its_kernels_and_they_take_no_other_types():
    TRACKERS["robust"]().start(box(), CAMERA, flown(1, seed=5)[0][0], np.random.default_rng(0))
    kernels = kernels_of(["uavbench.tracker.robust.tracker"])
    assert len(kernels) > 50
    for kernel in kernels:
        assert tuple(kernel.signatures) == kernel.declared
    with pytest.raises(TypeError):
        next(k for k in kernels if k.py_func.__name__ == "inverse6")(np.eye(6, dtype=np.complex128))


def test_kernels_of_a_fresh_machine_are_compiled_and_told_of_once(tmp_path):
    name = "uavbench.tracker.robust.preprocessing.denoising"
    code = f"import {name}\nfrom uavbench.trajectories.kernels.warm_up import kernels_of, prepare\n"
    code += f"prepare('{name}')\nprint({{len(k.signatures) for k in kernels_of(['{name}'])}})"
    path = os.pathsep.join(p for p in sys.path if p)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": path}
    runs = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
        for _ in range(2)
    ]
    assert [run.stdout for run in runs] == ["{1}\n", "{1}\n"]
    assert [run.stderr.startswith("compiling kernels") for run in runs] == [True, False]


def test_a_kernel_is_compiled_for_what_it_declares_whoever_calls_it():
    @compiled("f1 i0 | f2 i0")
    def first_of(values, k):
        return values.flat[k]

    KERNELS.remove(first_of)
    frozen = np.arange(3.0)
    frozen.flags.writeable = False
    assert first_of(frozen, 1) == first_of(np.arange(3.0), 1) == first_of(np.arange(4.0).reshape(2, 2), 1) == 1.0
    assert tuple(first_of.signatures) == first_of.declared == argument_types("f1 i0 | f2 i0", {})


def test_words_that_are_no_types_are_refused():
    with pytest.raises(ValueError, match="'q7' is not the type of an argument"):
        argument_types("f1 q7", {})


def test_preparing_twice_does_nothing():
    prepare("uavbench.tracker.shang_shen.pipeline")
    prepare("uavbench.tracker.shang_shen.pipeline")
    assert all(kernel.overloads for kernel in kernels_of(["uavbench.tracker.shang_shen.pipeline"]))


def test_an_inner_kernel_can_be_called_from_python_too():
    @compiled("f1", inner=True)
    def inner_sum(values):
        return values.sum()

    @compiled("f1")
    def outer_sum(values):
        return 2.0 * inner_sum(values)

    for kernel in (inner_sum, outer_sum):
        KERNELS.remove(kernel)
    assert outer_sum(np.arange(4.0)) == 12.0
    assert inner_sum(np.arange(4.0)) == inner_sum(np.arange(4.0)) == 6.0
    with pytest.raises(TypeError):
        inner_sum(np.eye(2))


def test_a_kernel_comes_after_those_that_it_calls():
    order = [kernel.py_func.__name__ for kernel in in_order(kernels_of(["uavbench.tracker.robust.tracker"]))]
    assert order.index("rodrigues") < order.index("so3_exp") < order.index("se3_exp_left") < order.index("refine")
    assert order.index("factor6") < order.index("inverse6")


def test_each_kernel_of_a_queue_is_taken_by_one_process():
    code = "import sys\nfrom uavbench.trajectories.kernels.warm_up import taken\nprint(*taken(sys.stdin.fileno()))"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    with queue_of(300) as queue:
        own = list(islice(taken(queue), 20))
        call = [sys.executable, "-c", code]
        run = subprocess.run(call, stdin=queue, capture_output=True, text=True, check=True, env=environment)
        assert list(taken(queue)) == []
    assert own + [int(word) for word in run.stdout.split()] == list(range(300))


def test_the_helper_ends_with_the_process_that_it_helps():
    out, into = os.pipe()  # a queue that we keep open, so that the helper waits for its next number
    helper = "[sys.executable, '-m', 'uavbench.trajectories.kernels.warm_up', str(os.getpid())]"
    code = (
        f"import os, subprocess, sys\nprint(subprocess.Popen({helper}, stdin={out}).pid, flush=True)\nos.read({out}, 1)"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], pass_fds=[out], stdout=subprocess.PIPE)
    try:
        pid = int(parent.stdout.readline())
        parent.kill()
        parent.communicate()
        assert wait_until(lambda: not is_alive(pid))
    finally:
        os.close(into)
        os.close(out)


def test_those_who_compile_take_turns_beside_the_kernels_and_leave_nothing_in_the_temporary_folder(
    tmp_path, monkeypatch
):
    (tmp_path / "tmp").mkdir()
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    place = tmp_path / "cache" / "uavbench" / "kernels" / warm_up.LOCK
    with warm_up._alone(), place.open() as lock, pytest.raises(BlockingIOError):
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with warm_up._alone():  # it was given back
        pass
    assert not list((tmp_path / "tmp").iterdir())
