"""The mutation tester's own parts: what it changes, what it leaves, and that its lists are of files that exist."""

import ast
import os
import subprocess
import sys

import pytest

from tests.mutation.mutants import mutants, sample
from tests.mutation.run import ROOT, accepted, copy_tree, own_paths
from tests.mutation.targets import GROUPS

SOURCE = '''"""Words."""

import math


def f(a: int, b: float = 2.0) -> bool:
    """More words: 1 < 2."""
    if a < 3 and not b:
        raise ValueError(f"{a + b}")
    a += 1
    g(a, b)
    return max(a, b) - b
'''
AFTER = {
    "def f(a: int, b: float = 4.0) -> bool:",
    "if (a <= 3) and not b:", "if (a >= 3) and not b:", "if a < 4 and not b:", "if (a < 3 or not b):",
    "if a < 3 and (b):",
    "pass", "a -= 1", "a += 2", "g(b, a)",
    "return None", "return (max(a, b) + b)", "return (b - max(a, b))",
}  # fmt: skip


@pytest.fixture
def every(tmp_path):
    (tmp_path / "one.py").write_text(SOURCE)
    return mutants(tmp_path, "one.py")


def test_every_kind_of_change_is_made_once_and_words_are_left(every):
    assert {m.after for m in every} == AFTER
    assert sum(m.after == "pass" for m in every) == 3  # the raise, the sum and the call
    assert len(every) == len(AFTER) + 2
    for m in every:
        ast.parse(m.source)
        changed = [(a, b) for a, b in zip(SOURCE.splitlines(), m.source.splitlines(), strict=True) if a != b]
        assert [(a.strip(), b.strip()) for a, b in changed] == [(m.before, m.after)]
        assert SOURCE.splitlines()[m.line - 1].strip() == m.before
        assert f"-{m.before}" in m.diff(SOURCE).replace("    ", "")


def test_a_sample_is_the_same_under_a_seed(every):
    assert sample(every, 100, 0) == every
    chosen = sample(every, 5, 1)
    assert len(chosen) == len(set(chosen)) == 5
    assert sample(every, 5, 1) == chosen != sample(every, 5, 2)


def test_targets_and_accepted_survivors_are_of_files_that_exist():
    targets = [target for group in GROUPS.values() for target in group]
    for target in targets:
        assert (ROOT / target.file).is_file(), target.file
        for test in target.tests:
            assert (ROOT / test).is_file(), test
    for (file, before, after), reason in accepted().items():
        assert file in {target.file for target in targets}
        assert before != after and reason


def test_every_accepted_survivor_is_a_mutant_of_its_file_as_it_stands():
    """An entry whose line has changed or gone excuses nothing and is to be removed."""
    of_file = {file: {mutant.key for mutant in mutants(ROOT, file)} for file in sorted({key[0] for key in accepted()})}
    assert not [key for key in accepted() if key not in of_file[key[0]]]


def test_a_copy_of_the_tree_is_tested_by_itself(tmp_path):
    tree = copy_tree(tmp_path / "tree")
    ask = "import tests.mutation.run as t, uavbench.bench.inputs.content_hash as c; print(t.__file__, c.__file__)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(own_paths(tree))}
    done = subprocess.run(
        [sys.executable, "-c", ask], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert all(line.startswith(str(tree)) for line in done.stdout.split()), done.stdout
    found = os.path.realpath(done.stdout.split()[1])
    assert found == str((tree / "bench" / "inputs" / "content_hash.py").resolve())
