"""A large kernel is compiled once and called by its symbol; a small one is linked into its callers.

None counts references to its arguments, and one that allocates nothing counts none.
"""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from numba.core.caching import NullCache

from uavbench.scenes.rendering.antialiasing.coverage import antialias
from uavbench.tracker.geometry_kernels import inverse6
from uavbench.trajectories.kernels.compiled import Kernel, compiled, unchecked

TERMS = "\n".join(f"    total += values[{k % 4}] * {k}.0 + len(values)" for k in range(30))
KERNELS = f"""from uavbench.trajectories.kernels.compiled import compiled


@compiled("f0", inner=True)
def twice(x):
    return 2.0 * x


@compiled("f1", inner=True)
def long_sum(values):
    total = 0.0
{TERMS}
    return twice(total)


@compiled("f1")
def outer(values):
    return long_sum(values) + twice(1.0)
"""
RUN = """import json
import sys
import numpy as np
from numba.core import event
import own_kernels

heard = []
class Listener(event.Listener):
    def on_start(self, event):
        heard.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass

event.register("numba:compile", Listener())
result = own_kernels.outer(np.arange(4.0))
kinds = {
    kernel.py_func.__name__: type(code.library).__name__
    for kernel in (own_kernels.twice, own_kernels.long_sum, own_kernels.outer)
    for code in kernel.overloads.values()
}
print(json.dumps([result, heard, kinds]))
"""
RESULT = 2.0 * sum(float(k % 4) * k + 4 for k in range(30)) + 2.0
KINDS = {"twice": "CodeLinkedIn", "long_sum": "CodeApart", "outer": "KernelCode"}


@pytest.mark.ci
def test_a_large_kernel_is_found_by_its_symbol_in_every_process_and_compiled_where_it_is_lost(tmp_path):
    (tmp_path / "own_kernels.py").write_text(KERNELS)
    assert run(tmp_path) == ["twice", "long_sum", "outer"]
    assert run(tmp_path) == []
    (file,) = tmp_path.glob("cache/**/own_kernels.long_sum*.nbc")
    file.unlink()
    assert run(tmp_path) == ["long_sum"]  # the same symbol: its callers need no compilation
    file.write_bytes(b"broken")
    assert run(tmp_path) == ["long_sum"]
    assert run(tmp_path) == []


def run(folder):
    """Names of the kernels that a process compiles to call one; checks its result, and how each is reached."""
    path = os.pathsep.join([str(folder), *(p for p in sys.path if p)])
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(folder / "cache")}
    command = [sys.executable, "-c", RUN]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    result, heard, kinds = json.loads(done.stdout)
    assert result == RESULT
    assert kinds == KINDS
    return [name for name in heard if name in KINDS]


@compiled("f1")
def itself(values):
    """What is given, to which the result is one reference more."""
    return values


@pytest.mark.parametrize(("reads", "allocates", "counts"), [(antialias, 0, 0), (antialias, 1, 0), (itself, 1, 1)])
def test_a_kernel_counts_references_to_what_it_returns_and_none_to_what_it_reads(reads, allocates, counts):
    kernel = Kernel(reads.py_func, reads.declared, inner=False, allocates=bool(allocates))
    kernel._cache = NullCache()  # what is loaded from the cache holds no object file
    kernel.compile(None)
    (code,) = kernel.overloads.values()
    assert (b"NRT_incref" in code.library._get_compiled_object()) == counts


def test_an_inlined_function_is_not_called():
    kernel = Kernel(antialias.py_func, antialias.declared, inner=False, allocates=False)
    kernel._cache = NullCache()
    kernel.compile(None)
    (code,) = kernel.overloads.values()
    called = set(re.findall(r"call [^\n]*?(_find_borders|one_surface)", code.library.get_llvm_str()))
    assert called == {"_find_borders"}


def test_an_unchecked_kernel_gives_the_same_and_refuses_numbers_of_another_size():
    A = np.diag(np.arange(1.0, 7.0))
    np.testing.assert_array_equal(unchecked(inverse6)(A), inverse6(A))
    for wrong in (A.astype(np.float32), None):
        with pytest.raises((TypeError, ValueError)):
            unchecked(inverse6)(wrong)


def test_what_is_no_kernel_is_called_as_it_is():
    assert unchecked(len) is len
