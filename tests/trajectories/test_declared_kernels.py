"""No kernel compiles in flight: one without declared arguments is called by other kernels alone."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from uavbench.scenes.generate import generate
from uavbench.trajectories.kernels.warm_up import kernels_of

ROOT = Path(__file__).parents[2]
FILES = {
    "uavbench." + ".".join(path.relative_to(ROOT).with_suffix("").parts): path
    for package in ("trajectories", "scenes", "tracker", "reports", "bench")
    for path in sorted((ROOT / package).rglob("*.py"))
}


@pytest.fixture(scope="module")
def trees():
    """The syntax trees of all modules, by name."""
    return {name: ast.parse(path.read_bytes()) for name, path in FILES.items()}


def decorated(node):
    """Whether a function is compiled; "for its callers" when it does not say for what, "inner" when it is so."""
    for decorator in getattr(node, "decorator_list", []):
        if isinstance(decorator, ast.Name) and decorator.id in ("compiled", "inlined"):
            return "for its callers"
        if isinstance(decorator, ast.Call) and getattr(decorator.func, "id", "") == "inlined":
            return "for its callers"
        if isinstance(decorator, ast.Call) and getattr(decorator.func, "id", "") == "compiled":
            return "inner" if any(word.arg == "inner" for word in decorator.keywords) else "as declared"
    return ""


@pytest.fixture(scope="module")
def undeclared(trees):
    """Names of the kernels without declared arguments."""
    return {
        f"{module}.{node.name}"
        for module, tree in trees.items()
        for node in tree.body
        if decorated(node) == "for its callers"
    }


@pytest.fixture(scope="module")
def called(trees):
    """For each module, the full names of all that its own Python code calls."""
    return {module: set(called_from_python(module, tree)) for module, tree in trees.items()}


def called_from_python(module, tree):
    """Full names of all that a module's own Python code calls, kernels left out."""
    named = {node.name: f"{module}.{node.name}" for node in tree.body if isinstance(node, ast.FunctionDef)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            named |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if decorated(node):
            continue
        if isinstance(node, ast.Call):
            function = node.func
            if isinstance(function, ast.Call) and getattr(function.func, "id", "") == "unchecked":
                (function,) = function.args
            if isinstance(function, ast.Name) and function.id in named:
                yield named[function.id]
            elif isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
                yield f"{named.get(function.value.id)}.{function.attr}"
        waiting += ast.iter_child_nodes(node)


def test_kernels_for_their_callers_are_there_and_some_are_declared(undeclared):
    assert "uavbench.trajectories.geometry.vectors.cross" in undeclared
    assert len(kernels_of([generate.__module__])) > 12


@pytest.mark.parametrize("kind", ["inner", "as declared"])
def test_a_kernel_is_inner_where_only_kernels_call_it(trees, called, kind):
    kernels = {
        f"{module}.{node.name}" for module, tree in trees.items() for node in tree.body if decorated(node) == kind
    }
    assert len(kernels) > 25
    by_python = set().union(*called.values())
    assert (kernels & by_python if kind == "inner" else kernels - by_python) == set()


@pytest.mark.parametrize("package", ["trajectories", "scenes", "tracker", "reports", "bench"])
def test_what_python_calls_is_declared(called, undeclared, package):
    found = {
        (module, name) for module in called if module.split(".")[1] == package for name in called[module] & undeclared
    }
    assert not found


def test_threads_that_call_a_kernel_first_at_once_all_get_its_result():
    """The first call loads the kernel or compiles it: twice, and numba would call it ambiguous."""
    program = """if True:
        from concurrent.futures import ThreadPoolExecutor
        from threading import Barrier
        import numpy as np
        from uavbench.trajectories import pose
        begin = Barrier(16)
        def turned(function):
            begin.wait()
            return function(np.eye(3)[None])[0]
        for function in (pose.quaternion_from_rotation, pose.rotation_log):
            with ThreadPoolExecutor(16) as pool:
                found = list(pool.map(turned, [function] * 16))
            assert all((each == found[0]).all() for each in found)
    """
    for _ in range(5):  # a race, that some processes win
        subprocess.run([sys.executable, "-c", program], check=True, timeout=300)


FIRST_CALLS_WITH_A_NEW_TYPE = """if True:
    import time
    from concurrent.futures import ThreadPoolExecutor
    from threading import Barrier, get_ident
    import numba
    import numpy as np
    from numba.core.types import abstract
    from uavbench.trajectories.kernels.compiled import compiled

    @compiled("u5")
    def first(numbers):
        return numbers[0, 0, 0, 0, 0]

    class Slow(dict):
        def get(self, key, default=None):
            found = super().get(key, default)
            if found is None and isinstance(key(), numba.types.Array):
                time.sleep(.01 * (get_ident() // 4096 % 7))
            return found

    abstract._typecache = Slow(abstract._typecache)
    begin = Barrier(16)

    def called(number):
        begin.wait()
        return int(first(np.full((1,) * 5, number, np.uint8)))

    with ThreadPoolExecutor(16) as pool:
        assert list(pool.map(called, range(16))) == list(range(16))
"""


def test_threads_whose_arguments_are_of_a_type_that_numba_has_not_met(tmp_path):
    """numba looks up which forms a call may take before it asks for its types, while another thread compiles."""
    program = tmp_path / "program.py"
    program.write_text(FIRST_CALLS_WITH_A_NEW_TYPE)
    for _ in range(3):  # compiled, then loaded twice
        subprocess.run([sys.executable, program], check=True, timeout=300)
