"""A mutation tester: changes one place of the code at a time, and lists the changes that no test notices.

Own code, for neither library fits: mutmut 3 calls each function through a trampoline, which numba does not compile, and
cosmic-ray starts an interpreter for each mutant and changes files in place; neither has a list of test files by module.

    python -m tests.mutation.run [GROUP or FILE ...] [--sample 20] [--seed 0] [--jobs 1] [--out survivors.txt]

Works in a copy of the tree. Each mutant is tried in a fork of a process that has loaded the libraries, by the tests
that `targets.py` names, those marked slow or ci left out, until the first that fails. Exits with 1 when a group is
below LEAST.
"""

import argparse
import contextlib
import importlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.mutation.mutants import Mutant, mutants, sample
from tests.mutation.targets import GROUPS, Target

ROOT = Path(__file__).parents[2]
LEAST = 0.9
"""Share of the mutants of a group that the tests must kill; accepted ones do not count."""
TIMES, LEAST_S = 10.0, 60.0
"""A mutant that takes so many times the CPU time of the unchanged code, and at least so many seconds, hangs: killed."""
WAITED_S = 600.0
"""A mutant that has not ended after this many seconds on the clock waits forever: killed."""
QUICK = "not slow and not ci"
"""The tests that are run, by their markers."""
LIBRARIES = (
    "numpy", "scipy.stats", "scipy.signal", "scipy.fft", "scipy.spatial.transform", "cv2", "numba", "pytest",
    "hypothesis", "pydantic", "click", "trimesh", "mujoco", "matplotlib.pyplot", "evo.tools.file_interface",
)  # fmt: skip
"""Loaded once, before the forks; never the project itself."""


@dataclass(frozen=True)
class Trial:
    """A mutant that is being tried, or the unchanged code (None): in which tree, by which process, until when."""

    mutant: Mutant | None
    tree: Path
    pid: int
    until: float


def accepted() -> dict[tuple[str, str, str], str]:
    """Reasons of the survivors that no test can tell, by the mutant's key."""
    rows = tomllib.loads((Path(__file__).parent / "accepted.toml").read_text(encoding="utf-8")).get("survivor", [])
    return {(row["file"], row["before"], row["after"]): row["reason"] for row in rows}


def copy_tree(to: Path) -> Path:
    """A copy of what git knows or would take in; of an unpacked archive, of all but hidden folders and results."""
    if not (ROOT / ".git").exists():
        return shutil.copytree(ROOT, to, symlinks=True, ignore=shutil.ignore_patterns(".*", "out", "__pycache__"))
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    for name in subprocess.run(listed, cwd=ROOT, capture_output=True, check=True).stdout.decode().split("\0"):
        if name and (ROOT / name).exists():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, to / name, follow_symlinks=False)
    return to


def own_paths(tree: Path) -> list[str]:
    """Where Python finds a tree's package and its tests."""
    return [str(tree / "src"), str(tree)]


def begin(target: Target, mutant: Mutant | None, tree: Path, limit_s: float = resource.RLIM_INFINITY) -> Trial:
    """Start the tests of a target in a fork, over a tree that holds the mutant; limit_s: of processor time."""
    if mutant is not None:
        (tree / mutant.file).write_text(mutant.source, encoding="utf-8")
    pid = os.fork()
    if not pid:
        status = 1
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s), int(limit_s)))
            status = _tested(target, tree)
        finally:
            os._exit(status)
    return Trial(mutant, tree, pid, time.monotonic() + WAITED_S)


def _tested(target: Target, tree: Path) -> int:
    """The tests' exit status, in this process, which is a fork of its own."""
    os.setsid()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    out = os.open(tree.parent / f"{tree.name}.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(out, 1)
    os.dup2(out, 2)
    os.chdir(tree)
    sys.dont_write_bytecode = True
    own = own_paths(tree)
    sys.path[:] = [*own, *(path for path in sys.path if not (Path(path) / "uavbench").is_dir() and path != str(ROOT))]
    for name in [name for name in sys.modules if name.split(".")[0] == "tests"]:
        del sys.modules[name]
    os.environ["PYTHONPATH"] = os.pathsep.join(own)
    import hypothesis
    import numba
    import pytest

    numba.config.DISABLE_JIT = target.uncompiled
    hypothesis.settings.register_profile("mutation", database=None, derandomize=True)
    hypothesis.settings.load_profile("mutation")
    options = ["-x", "-q", "-m", QUICK, "-p", "no:cacheprovider", f"--basetemp={tree.parent / tree.name}-tmp"]
    return int(pytest.main([*options, *target.tests]))


def ended(trial: Trial) -> int | None:
    """Exit status of a trial, 1 when it took too long, None while it runs."""
    pid, status = os.waitpid(trial.pid, os.WNOHANG)
    if pid:
        return os.waitstatus_to_exitcode(status)
    if time.monotonic() < trial.until:
        return None
    with contextlib.suppress(ProcessLookupError):
        os.killpg(trial.pid, signal.SIGKILL)
    os.waitpid(trial.pid, 0)
    return 1


def _children_s() -> float:
    """Processor time in s of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def survivors(target: Target, chosen: list[Mutant], trees: list[Path]) -> Iterator[Mutant]:
    """Those of the mutants of a target that its tests let pass; SystemExit when these fail without any."""
    original = (trees[0] / target.file).read_text(encoding="utf-8")
    before_s = _children_s()
    whole = begin(target, None, trees[0])
    while (status := ended(whole)) is None:
        time.sleep(0.02)
    if status:
        log = (trees[0].parent / f"{trees[0].name}.log").read_text(encoding="utf-8", errors="replace")
        raise SystemExit(f"{target.file}: the tests fail on the unchanged code:\n{log[-3000:]}")
    limit_s = max(LEAST_S, TIMES * (_children_s() - before_s))
    waiting, free, running = list(reversed(chosen)), list(trees), list[Trial]()
    try:
        while waiting or running:
            while waiting and free:
                running.append(begin(target, waiting.pop(), free.pop(), limit_s))
            time.sleep(0.02)
            for trial in list(running):
                status = ended(trial)
                if status is None:
                    continue
                running.remove(trial)
                free.append(trial.tree)
                (trial.tree / target.file).write_text(original, encoding="utf-8")
                if status == 0 and trial.mutant is not None:
                    yield trial.mutant
    finally:
        for trial in running:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(trial.pid, signal.SIGKILL)


def main() -> int:
    """Try the mutants of the groups or files asked for, print and write what survived."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", nargs="*", metavar="GROUP or FILE", help=f"of {', '.join(GROUPS)}; all by default")
    parser.add_argument("--sample", type=int, default=20, help="mutants of each file (default 20; 0: every one)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--jobs", type=int, default=1, help="mutants at a time")
    parser.add_argument("--out", type=Path, help="file for the survivors, with their diffs")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the copies of the tree are removed
    for name in LIBRARIES:
        importlib.import_module(name)
    known, lines, low = accepted(), [], []
    with tempfile.TemporaryDirectory(prefix="mutation-") as folder:
        trees = [copy_tree(Path(folder) / f"tree{k}") for k in range(given.jobs)]
        for group, targets in GROUPS.items():
            killed = total = excused = 0
            for target in targets:
                if given.what and not {group, target.file} & set(given.what):
                    continue
                every = mutants(trees[0], target.file)
                chosen = sample(every, given.sample or len(every), given.seed)
                left = list(survivors(target, chosen, trees))
                reasons = {mutant: known[mutant.key] for mutant in left if mutant.key in known}
                stale = [key for key in known if key[0] == target.file and key not in {m.key for m in every}]
                original = (trees[0] / target.file).read_text(encoding="utf-8")
                told = [f"{target.file}: {len(chosen) - len(left)} of {len(chosen)} killed ({len(every)} in the file)"]
                told += [f"{m.file}:{m.line}: {reasons.get(m, 'SURVIVED')}\n{m.diff(original)}" for m in left]
                told += [f"{target.file}: accepted, but no mutant any more: {before}" for _, before, _ in stale]
                print("\n".join(told), flush=True)
                lines += told
                total, killed, excused = total + len(chosen), killed + len(chosen) - len(left), excused + len(reasons)
            if total:
                share = killed / max(1, total - excused)
                lines.append(f"== {group}: {killed} of {total} killed, {excused} accepted: {share:.1%}")
                print(lines[-1], flush=True)
                low += [group] if share < LEAST else []
    if given.out:
        given.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 1 if low else 0


if __name__ == "__main__":
    sys.exit(main())
