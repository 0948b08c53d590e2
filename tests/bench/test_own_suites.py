"""The flights of every suite that comes with the program can be flown."""

import pytest

from uavbench.bench.config.suite import load_suite
from uavbench.bench.config.suite_files import suite_file, suite_names
from uavbench.scenes.scene import build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.simulation.flight import fly


@pytest.mark.ci
@pytest.mark.parametrize("name", suite_names())
def test_its_first_seed_flies(name):
    specs = [spec for spec in load_suite(suite_file(name)).sequences if isinstance(spec, SequenceSpec)]
    first = min((spec.seed for spec in specs), default=0)
    for spec in specs:
        if spec.seed == first:
            assert fly(spec.flight, spec.mount, build_scene(spec).obstacles, spec.seed).status == "completed", spec.name
