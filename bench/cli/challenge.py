"""The commands of a challenge: pack, score-submission, leaderboard."""

import sys
from pathlib import Path

import click

from uavbench.bench.cli.cores import jobs_option
from uavbench.bench.cli.values import FILE
from uavbench.bench.said import say
from uavbench.trajectories.errors import UserError


@click.command("pack")
@click.argument("suite")
@click.option("--without-truth", is_flag=True, help="Withhold ground truth and seeds, as every package does.")
@click.option("--out", type=FILE, required=True, help="Folder for the participants.")
@click.option("--truth", type=FILE, help="Private folder of the organizer; default: out/SUITE-truth.")
@click.option("--secret", type=FILE, help="File of the secret, created if absent; default: in --truth.")
@click.option(
    "--private-suite", is_flag=True, help="No participant will see SUITE's file: its paths may be deterministic."
)
@jobs_option()
def pack_command(
    suite: str, without_truth: bool, out: Path, truth: Path | None, secret: Path | None, private_suite: bool, jobs: int
) -> None:
    """Write a package of SUITE, rendered with secret seeds, for the participants of a challenge."""
    from uavbench.bench.challenge.pack import Packing, pack

    if not without_truth:
        raise UserError(
            "pack writes the package for participants: confirm with --without-truth; `uavbench render` writes "
            "sequences with their ground truth"
        )
    kept = truth or Path("out") / f"{Path(suite).stem}-truth"
    where = Packing(out=out, truth=kept, secret=secret, private_suite=private_suite, workers=jobs)
    sys.exit(pack(suite, where))


@click.command("score-submission")
@click.argument("truth", type=FILE)
@click.argument("submission", type=FILE)
@click.option("--out", type=FILE, help="File of the score; default: TRUTH/submissions/NAME OF THE FOLDER.json.")
def score_submission_command(truth: Path, submission: Path, out: Path | None) -> None:
    """Score the folder of a SUBMISSION against TRUTH, the organizer's folder that `pack` made."""
    from uavbench.bench.challenge.scoring import score_submission

    found = score_submission(truth, submission)
    path = out or truth / "submissions" / f"{submission.resolve().name}.json"
    before = found.save(path)
    if before != found:
        say(
            f"{path}: replaced the score of {before.score:.1f} points of an earlier submission called {before.name!r}; "
            "if that was another participant's, name each in its submission.toml, and score both again",
            err=True,
        )
    for fault in found.faults:
        say(fault, err=True)
    say(f"{found.name}: {found.score:.1f} of 100 points ({found.counted} of {len(found.runs)})")
    for name, each in found.runs[found.counted].items():
        shares = f"{100 * each.success:.1f} % within 5 cm and 5 deg, {100 * each.coverage:.1f} % with a pose"
        say(f"  {name}: {each.points:.1f} points, {shares}, of {each.frames} frames")
    say(path)


@click.command("leaderboard")
@click.argument("scores", type=FILE, nargs=-1, required=True)
@click.option("--out", type=FILE, required=True, help="Folder of the page.")
@click.option("--title", default="Leaderboard", show_default=True)
def leaderboard_command(scores: tuple[Path, ...], out: Path, title: str) -> None:
    """Rank submissions by their SCORES, files that score-submission wrote, on a static page."""
    from uavbench.reports.leaderboard.page import write_leaderboard
    from uavbench.reports.leaderboard.submission_score import SubmissionScore

    say(write_leaderboard(out, [SubmissionScore.load(path) for path in scores], title))


COMMANDS: tuple[click.Command, ...] = (pack_command, score_submission_command, leaderboard_command)
