"""The commands that evaluate changes: gate, history, compare, bisect, speed, sensitivity."""

import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from uavbench.bench.cli.cores import jobs_option
from uavbench.bench.cli.values import FILE
from uavbench.bench.said import say

if TYPE_CHECKING:
    from uavbench.bench.gate.decision import Margins


def margin_options(command: Callable[..., None]) -> Any:
    """Decorator that adds the options of the margins and passes them to the command as `margins`."""

    @wraps(command)
    def with_margins(
        *, margin: float, latency_margin: float, coverage_margin: float, resolution: float, **others: Any
    ) -> None:
        from uavbench.bench.gate.decision import Margins

        margins = Margins(error=margin, latency=latency_margin, coverage=coverage_margin, resolution=resolution)
        command(margins=margins, **others)

    added: Any = with_margins
    for name, default, about in (
        ("--resolution", "10%", "Smallest regression that a pass must rule out."),
        ("--coverage-margin", "1%", "Tolerated loss of coverage, as a fraction of all frames."),
        ("--latency-margin", "5%", "Tolerated growth of latency."),
        ("--margin", "1%", "Tolerated growth of errors."),
    ):
        added = click.option(name, default=default, show_default=True, callback=share, help=about)(added)
    return added


def share(ctx: click.Context, parameter: click.Parameter, text: str) -> float:
    """Parse a share written as `5%` or `0.05`; values of 1 and above need a `%`, since `5` may mean 5 % or 500 %."""
    number, percent = text.strip().removesuffix("%"), text.strip().endswith("%")
    try:
        value = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        value = -1.0
    if value >= 1.0 and not percent:
        raise click.BadParameter(
            f"{text!r} would be {100 * value:g} %: write {number}% for {number} percent, or a share below 1 as in 0.05"
        )
    if not 0.0 <= value < 10.0:
        raise click.BadParameter(f"{text!r} is not a share from 0% to 1000%: write 5% or 0.05")
    return value


@click.command("gate")
@click.argument("results", type=FILE)
@click.option(
    "--baseline",
    type=FILE,
    help="Folder of a run on the same frames, or a file made by --update.",
)
@click.option("--update", is_flag=True, help="Write RESULTS as the new baseline file, without comparing.")
@click.option(
    "--record",
    "history",
    type=FILE,
    help="History file that RESULTS are added to, one line per commit.",
)
@click.option("--commit", default="", metavar="REF", help="Commit of the line; default: the one checked out.")
@click.option("--environment", default="", metavar="NAME", help="Name of the machines that share a history.")
@margin_options
@click.option("--out", type=FILE, help="Folder of gate.json, .xml, .md; default: RESULTS/gate.")
def gate_command(
    results: Path,
    baseline: Path | None,
    update: bool,
    history: Path | None,
    margins: "Margins",
    out: Path | None,
    **where: str,
) -> None:
    """Decide whether RESULTS are worse than a baseline: exit code 0 pass, 1 fail, 3 inconclusive.

    With --record RESULTS are also added to a history; without --baseline nothing else is done.
    """
    if baseline is None and (history is None or update):
        raise click.UsageError("give --baseline to compare with, or --record to keep the results")
    verdict = out or results / "gate"
    if baseline is not None and not update:
        from uavbench.bench.runner.output_folder import remove_verdict

        remove_verdict(verdict)  # first, because the record may be refused
    if history is not None:
        from uavbench.bench.history.record import Where, record

        record(results, Where(history, where["commit"], where["environment"]))
        say(history, err=True)
    if baseline is None:
        return
    if update:
        from uavbench.bench.gate.baseline import write_baseline
        from uavbench.bench.gate.paired_scores import read_side

        write_baseline(read_side(results), baseline)
        say(baseline)
        return
    from uavbench.bench.gate.findings import pronounce

    sys.exit(pronounce(results, baseline, margins, verdict))


@click.command("history")
@click.argument("file", type=FILE)
@click.option("--margin", default="1%", show_default=True, callback=share, help="Smallest change that is reported.")
@click.option("--since", default="", metavar="COMMIT", help="Changes before this commit are accepted: no alarm.")
@click.option("--out", type=FILE, required=True, help="Folder of the page, figures and forms.")
def history_command(file: Path, margin: float, since: str, out: Path) -> None:
    """Draw the trends of a history FILE with their change points: exit code 0 without an alarm, 1 with one."""
    from uavbench.reports.history.change_points import LEAST_COMMITS
    from uavbench.reports.history.history_file import read_history
    from uavbench.reports.history.page import write_trends
    from uavbench.reports.history.trend import trends

    history = read_history(file)
    found = trends(history, margin, since)
    page = write_trends(out, history, found)
    for trend in found:
        for change in trend.changes:
            say(f"{'ALARM  ' if change in trend.alarms else ''}{trend.said(change)}")
    if len(history.commits) < LEAST_COMMITS:
        say(f"{len(history.commits)} of the {LEAST_COMMITS} commits needed to test for changes")
    say(page)
    sys.exit(1 if any(trend.alarms for trend in found) else 0)


@click.command("speed")
@click.option("--only", default="", help="Only benchmarks whose names match this expression of pytest's -k.")
@click.option("--save", type=FILE, help="File for pytest-benchmark's own JSON.")
def speed_command(only: str, save: Path | None) -> None:
    """Run the benchmarks and print their times against the goals."""
    from uavbench.bench.speed.table import speed

    sys.exit(speed(only, save))


@click.command("compare")
@click.argument("base_ref")
@click.argument("head_ref", default=".")
@click.option("--suite", default="gate", show_default=True, help="Suite that both versions' trackers run on.")
@click.option("--repeats", type=click.IntRange(1), default=3, show_default=True, help="Runs of each, for the latency.")
@jobs_option("Processes that render")
@click.option("--out", type=FILE, default=Path("out/compare"), show_default=True)
@margin_options
def compare_command(
    base_ref: str, head_ref: str, suite: str, repeats: int, jobs: int, out: Path, margins: "Margins"
) -> None:
    """Run two versions of this git repository on the same frames and let the gate decide; `.` is the working tree."""
    from uavbench.bench.gate.compare import compare

    sys.exit(compare((base_ref, head_ref), suite, out, repeats, margins, jobs))


@click.command("bisect")
@click.argument("good")
@click.argument("bad", default="HEAD")
@click.option(
    "--metric", default="ATE", show_default=True, help="What became worse: ATE, ATE rotation, RPE 1 s, coverage."
)
@click.option("--tracker", default="", metavar="LABEL", help="Of the suite, or LABEL@RATEhz; default: its only one.")
@click.option("--suite", default="gate", show_default=True, help="Suite that the commits' trackers run on.")
@click.option("--margin", default="1%", show_default=True, callback=share, help="BAD must be worse by more than this.")
@jobs_option("Processes that render")
@click.option("--out", type=FILE, default=Path("out/bisect"), show_default=True)
def bisect_command(
    good: str, bad: str, metric: str, tracker: str, suite: str, margin: float, jobs: int, out: Path
) -> None:
    """Find the commit after GOOD, up to BAD, that made a metric worse: exit code 0 one commit, 3 several are left."""
    from uavbench.bench.history.measuring import What, run_bisect

    sys.exit(run_bisect((good, bad), What(suite, metric, tracker), out, margin, jobs))


@click.command("sensitivity")
@click.argument("suite")
@click.option("--tracker", default="robust", show_default=True, help="Label of the suite's tracker that is studied.")
@click.option("--value", multiple=True, metavar="PATH", help="A value, or a table of them; default: all.")
@jobs_option()
@click.option("--out", type=FILE, required=True, help="Folder for everything.")
def sensitivity_command(suite: str, tracker: str, value: tuple[str, ...], jobs: int, out: Path) -> None:
    """Halve and double each number of a tracker's config, one at a time, and tabulate success and error."""
    from uavbench.bench.sensitivity.study import study

    sys.exit(study(suite, out, tracker, value, jobs))


COMMANDS: tuple[click.Command, ...] = (
    gate_command,
    history_command,
    speed_command,
    compare_command,
    bisect_command,
    sensitivity_command,
)
