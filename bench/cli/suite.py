"""The commands over a suite: run, render, track, score, report."""

import gc
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import click

from uavbench.bench.cli.cores import jobs_option
from uavbench.bench.cli.values import FILE, filled
from uavbench.bench.said import say
from uavbench.trajectories.errors import UserError


def suite_options(command: Any) -> Any:
    """Options of every command over a suite."""
    for option in (
        click.option("--slurm-option", multiple=True, metavar="KEY=VALUE", help="Slurm option, named as in submitit."),
        click.option("--slurm", type=click.IntRange(0), default=0, metavar="N", help="Run as N shards on Slurm."),
        click.option("--dask", callback=filled, metavar="ADDRESS", help="Dask scheduler, tcp://HOST:PORT, or `local`."),
        click.option(
            "--shard", callback=filled, metavar="i/N", help="Every N-th sequence from the i-th on; no report."
        ),
        click.option("--isolate", is_flag=True, help="External trackers see only their job folder; no other code."),
        click.option("--dry-run", is_flag=True, help="Print the plan, its time and its size; do nothing."),
        jobs_option(),
        click.option("--out", type=FILE, help="Folder for everything; default: out/SUITE."),
    ):
        command = option(command)
    return command


def suite_command(verb: str, help_text: str) -> click.Command:
    """Command that runs a suite up to one step of render -> track -> score -> report."""

    @click.command(verb, help=help_text)
    @click.argument("suite")
    @suite_options
    def command(suite: str, **options: Any) -> None:
        sys.exit(bring_up_to("report" if verb == "run" else verb, suite, **options))

    return figures_option(command) if verb in ("run", "report") else command


def figures_option(command: Any) -> Any:
    """Options of a command that writes a report."""
    about = "Figures that are drawn: those of the first page, or all, with a page for every sequence."
    choice = click.Choice(["page", "all"])
    return click.option("--figures", type=choice, default="page", show_default=True, help=about)(command)


@click.command("fly")
@click.argument("suite")
@suite_options
@figures_option
@click.option("--video", is_flag=True, help="A video of each flight: the camera's view next to an external one.")
def fly_command(suite: str, **options: Any) -> None:
    """Fly SUITE in closed loop: the vehicle flies on the poses of each tracker."""
    sys.exit(bring_up_to("fly", suite, **options))


def bring_up_to(verb: str, suite: str, out: Path | None, jobs: int, slurm_option: tuple[str, ...], **where: Any) -> int:
    """Run a suite up to a step and return the exit code."""
    gc.disable()  # these imports make no garbage; collections in them took a tenth of their time
    try:
        from uavbench.bench.runner.commands import ExecutionOptions, bring_up_to
    finally:
        gc.enable()

    return bring_up_to(verb, suite, out, ExecutionOptions(workers=jobs, slurm_options=slurm_option, **where))


@dataclass(frozen=True)
class RealImages:
    """Options of `track` for real images: their source, the structure, the camera and the initial pose."""

    images: Path | None
    video: Path | None
    bag: Path | None
    image_topic: str | None
    model: Path | None
    camera: Path | None
    init: Path | None
    rate_hz: float | None


@click.command("track")
@click.argument("what")
@suite_options
@click.option("--images", type=FILE, help="Folder of images to run the tracker WHAT on, in the order of their names.")
@click.option("--video", type=FILE, help="Video to run the tracker WHAT on.")
@click.option("--bag", type=FILE, help="ROS 2 bag (.mcap, .db3, or a folder with metadata.yaml) to run WHAT on.")
@click.option("--image-topic", metavar="TOPIC", help="Topic of --bag with Image or CompressedImage messages.")
@click.option("--model", type=FILE, help="Structure: .obj .stl .ply .glb .cao ... (with real images).")
@click.option("--camera", type=FILE, help="camera.toml (with real images).")
@click.option("--init", type=FILE, help="init.toml: initial pose, or points to solve it from.")
@click.option("--rate-hz", type=click.FloatRange(0, min_open=True), help="Rate of --images; default 30.")
def track_command(what: str, **options: Any) -> None:
    """Run the trackers of the suite WHAT, rendering what is missing; or the tracker WHAT on real images."""
    real = RealImages(**{f.name: options.pop(f.name) for f in fields(RealImages)})
    if real.images or real.video or real.bag:
        track_real_images(what, real, options["out"])
    else:
        sys.exit(bring_up_to("track", what, **options))


def track_real_images(kind: str, real: RealImages, out: Path | None) -> None:
    """Run a tracker on real images; UserError for missing or mutually exclusive options."""
    from uavbench.bench.runner.commands import track_real
    from uavbench.tracker.images.track_images import RATE_HZ, refuse_another_rate
    from uavbench.trajectories.bags.reading import BagTopic

    given = [source for source in (real.images, real.video, real.bag) if source is not None]
    if len(given) > 1:
        raise UserError("give one of --images, --video and --bag")
    if (real.bag is None) != (real.image_topic is None):
        raise UserError("--bag FILE and --image-topic TOPIC go together")
    if real.model is None or real.camera is None or real.init is None or out is None:
        raise UserError("tracking real images needs --model, --camera, --init and --out")
    source = BagTopic(real.bag, real.image_topic) if real.bag and real.image_topic else given[0]
    if real.rate_hz is not None:
        refuse_another_rate(source, real.rate_hz)
    track_real(kind, source, real.model, real.camera, real.init, out, real.rate_hz or RATE_HZ)


@click.command("tables")
@click.argument("report", type=FILE)
@click.option("--columns", default="", metavar="HEAD,HEAD...", help="Column headings as in tables/*.md; default: all.")
@click.option(
    "--width", type=click.Choice(["one", "two"]), default="two", show_default=True, help="IEEE columns (.tex)."
)
@click.option("--out", type=FILE, help="File .tex, .md or .csv; default: Markdown on the terminal.")
def tables_command(report: Path, columns: str, width: str, out: Path | None) -> None:
    """Write a table of the report in the folder REPORT, with columns of your choice."""
    from uavbench.reports.tables.writers import OWN_TABLE, WIDTHS, heads_of, markdown, write_table
    from uavbench.reports.tables.written_scores import table_of

    table = table_of(report).select(heads_of(columns)) if columns else table_of(report)
    say(write_table(table, out, WIDTHS[width], kind=OWN_TABLE) if out else markdown(table), nl=out is not None)


COMMANDS: tuple[click.Command, ...] = (
    suite_command("run", "Render, track, score and report SUITE (a name or a TOML file); one with a [loop] is flown."),
    suite_command("render", "Render the sequences of SUITE."),
    fly_command,
    suite_command("score", "Score the results of SUITE, making what is missing."),
    suite_command("report", "Write the report of SUITE, making what is missing."),
    track_command,
    tables_command,
)
