"""The command answers at once: it imports no more than a verb needs, and `list` imports no plug-in."""

import subprocess
import sys

import pytest

from uavbench.bench.config.inventory import registered
from uavbench.bench.config.plugins import PLUGINS

OURS = {"uavbench.tracker", "uavbench.scenes", "uavbench.reports"}
HEAVY = OURS | {"numba", "mujoco", "numpy", "scipy", "matplotlib", "pandas", "pydantic", "cv2"}
CODE = """
import sys
from uavbench.bench.cli.main import main
try:
    main({arguments}) if {arguments} is not None else None
except SystemExit as end:
    assert not end.code, end.code
print("loaded:", *sorted(sys.modules))
"""


@pytest.mark.parametrize("arguments", [None, ["--help"], ["--version"], ["run", "--help"], ["list"]])
def test_no_heavy_module_is_imported(arguments, tmp_path):
    code = CODE.format(arguments=arguments)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.splitlines()[-1].split()[1:])
    assert "uavbench.bench.cli.main" in loaded
    assert not loaded & HEAVY


def test_the_plugins_that_are_listed_are_those_that_there_are():
    there = {
        protocol.__name__: {kind: " ".join((cls.__doc__ or "").split()) for kind, cls in registry.items()}
        for protocol, (registry, _) in PLUGINS.items()
    }
    read = {
        protocol: {kind: " ".join(words.split()) for kind, words in plugins.items()}
        for protocol, plugins in registered().items()
    }
    assert read == there
