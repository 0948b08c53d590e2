"""`uavbench pack`: render a suite with secret seeds, and write the package for participants."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from uavbench.bench.challenge.guesses import refuse_guessed
from uavbench.bench.challenge.organizer import SECRET, Challenge
from uavbench.bench.challenge.package import PACKAGE, write_package
from uavbench.bench.challenge.secret import read_or_make
from uavbench.bench.config.suite import Suite, load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.inputs.content_hash import carried_hash
from uavbench.bench.runner.commands import disowned_if_ended, refuse_touched, tell
from uavbench.bench.runner.executors import local_pool
from uavbench.bench.runner.graph import Job, run_graph
from uavbench.bench.runner.jobs import plan
from uavbench.bench.runner.output_folder import resolved, suite_folder
from uavbench.bench.said import say
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.folders import try_place
from uavbench.trajectories.files.origin import refuse_foreign

TRUTH = "ground truth of a challenge"


@dataclass(frozen=True, kw_only=True)
class Packing:
    """Output folders of a package: `out` for the participants, `truth` for the organizer alone.

    secret: file of the secret, by default in `truth`; private_suite: the suite's file is never shown to participants.
    """

    out: Path
    truth: Path
    secret: Path | None = None
    private_suite: bool = False
    workers: int = 1


def pack(suite_name: str, where: Packing) -> int:
    """Render the missing sequences of a suite with secret seeds and write its package; exit code as `bring_up_to`.

    UserError for a suite that cannot be a challenge, nested folders, a weak secret, flights that can be guessed from
    the suite's file, and a ground truth rendered by another version; and when an input was written while sequences were
    rendered from it.
    """
    suite = load_suite(suite_file(suite_name))
    specs = _rendered(suite)
    out, truth = resolved(where.out), resolved(where.truth)
    secret_file = resolved(where.secret) if where.secret else truth / SECRET
    _refuse_together(out, truth, secret_file)
    refuse_foreign(out, PACKAGE)
    try_place(out)
    with suite_folder(truth, suite, kind=TRUTH):
        secret = read_or_make(secret_file)
        hidden = {spec.name: replace(spec, seed=secret.seed(spec.name)) for spec in specs}
        planned = partial(plan, replace(suite, sequences=tuple(hidden.values())), truth, "render")
        jobs = planned()
        challenge = Challenge.of(suite, secret, (job.content_hash for job in jobs))
        challenge.refuse_other(truth)
        _refuse_replaced(jobs, truth)
        with disowned_if_ended(jobs, planned), local_pool(where.workers) as pool:
            outcome = run_graph(jobs, *pool)
            tell(outcome, truth, suite_name)
            refuse_touched(jobs, planned, outcome.done)
        if outcome.failed:
            return 2 if outcome.users_mistake else 1
        challenge.save(truth)
        sequences = {
            alias: Sequence.load(truth / "sequences" / kept.name) for alias, kept in challenge.sequences.items()
        }
        if not where.private_suite:
            for sequence in sequences.values():
                refuse_guessed(hidden[sequence.name], sequence.ground_truth)
        write_package(out, challenge, sequences, suite.start)
    if others := sorted({name for sequence in sequences.values() for name in sequence.cameras}):
        say(f"not in the package, as trackers are given the main camera alone: images of {', '.join(others)}", err=True)
    say(f"for the organizer alone, with the secret and the ground truth: {truth}", err=True)
    say(out)
    return 0


def _refuse_replaced(jobs: Iterable[Job], truth: Path) -> None:
    """Raise UserError when rendering would replace the ground truth that packages already given out belong to.

    No package was written of one that is disowned.
    """
    for job in jobs:
        is_of_another = carried_hash(job.marker) not in (None, job.content_hash)
        if not job.place.is_disowned and (is_of_another or (job.made.is_whole and not job.fresh)):
            raise UserError(
                f"{truth}: its {job.marker.parent.name} was rendered by another version of uavbench, a library, a "
                "plug-in or a file that one reads; rendered again, the submissions to its package would be scored "
                "against another ground truth; pack with those versions, or name another folder with --truth, for a "
                "new package"
            )


def _rendered(suite: Suite) -> list[SequenceSpec]:
    """The sequences of a suite; UserError for recordings, closed loops, and gimbals."""
    if suite.loops:
        raise UserError(f"suite {suite.name} is flown in closed loop: a package needs images rendered beforehand")
    specs = [spec for spec in suite.sequences if isinstance(spec, SequenceSpec)]
    if len(specs) < len(suite.sequences):
        raise UserError(
            f"suite {suite.name} has recorded images; challenges are of rendered ones: leave its [recordings] out. "
            "Where their true poses are known, `uavbench evaluate` scores results of others against them"
        )
    for spec in specs:
        if not isinstance(spec.mount, Mount):
            raise UserError(
                f"suite {suite.name}: {spec.name} has its camera on a gimbal: submissions may hold poses of the body, "
                "which needs a fixed mount"
            )
    return specs


def _refuse_together(out: Path, truth: Path, secret: Path) -> None:
    """Raise UserError when one of both folders contains the other, or the package would contain the secret."""
    if out == truth or out.is_relative_to(truth) or truth.is_relative_to(out):
        raise UserError(f"--out {out} and --truth {truth} must not contain each other; participants get all of --out")
    if secret.is_relative_to(out):
        raise UserError(f"--secret {secret} lies in --out {out}, all of which participants get; put it elsewhere")
