"""The command `uavbench`: every verb reads and writes files, and is short here."""

import os
import sys
from pathlib import Path
from typing import Any

import click

from trajectories.errors import UserError


class Group(click.Group):
    """Prints a user's mistake as one message, without a traceback, and exits with code 2."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command that was asked for."""
        try:
            return super().invoke(ctx)
        except UserError as error:
            click.echo(f"uavbench: {error}", err=True)
            ctx.exit(2)
        except KeyboardInterrupt:
            click.echo("uavbench: interrupted; the same command goes on from here", err=True)
            ctx.exit(130)


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="uavbench")
def main() -> None:
    """Ground truth for model-based UAV localization: render flights, run trackers, score, report."""


FILE = click.Path(path_type=Path)


def suite_options(command: Any) -> Any:
    """What every command over a suite takes."""
    for option in (
        click.option("--slurm-option", multiple=True, metavar="KEY=VALUE", help="As submitit names them."),
        click.option("--slurm", type=click.IntRange(0), default=0, metavar="N", help="Run as N shards on Slurm."),
        click.option("--dask", default="", metavar="ADDRESS", help="Dask scheduler, tcp://HOST:PORT, or `local`."),
        click.option("--shard", default="", metavar="i/N", help="Every N-th sequence, from the i-th on; no report."),
        click.option("--dry-run", is_flag=True, help="Print the plan and the time it will take; do nothing."),
        click.option("--jobs", type=click.IntRange(1), default=os.cpu_count(), help="Processes; default: all cores."),
        click.option("--out", type=FILE, help="Folder for everything; default: out/SUITE."),
    ):
        command = option(command)
    return command


def suite_command(verb: str, help_text: str) -> None:
    """Command that brings a suite up to one verb of render -> track -> score -> report."""

    @main.command(verb, help=help_text)
    @click.argument("suite")
    @suite_options
    def command(suite: str, **options: Any) -> None:
        sys.exit(bring_up_to("report" if verb == "run" else verb, suite, **options))


def bring_up_to(verb: str, suite: str, out: Path | None, jobs: int, slurm_option: tuple[str, ...], **where: Any) -> int:
    """Bring a suite up to one verb; the exit code."""
    from bench.verbs import Where, bring_up_to

    return bring_up_to(verb, suite, out, Where(workers=jobs, slurm_options=slurm_option, **where))


suite_command("run", "Render, track, score and report SUITE (a name or a TOML file).")
suite_command("render", "Render the sequences of SUITE.")


@main.command("track")
@click.argument("what")
@suite_options
@click.option("--images", type=FILE, help="Folder of images to run the tracker WHAT on, in the order of their names.")
@click.option("--video", type=FILE, help="Video to run the tracker WHAT on.")
@click.option("--model", type=FILE, help="Structure: .obj .stl .ply .glb .cao ... (with --images or --video).")
@click.option("--camera", type=FILE, help="camera.toml (with --images or --video).")
@click.option("--init", type=FILE, help="init.toml: first pose, or points to solve it from.")
@click.option("--rate-hz", type=click.FloatRange(0, min_open=True), default=30.0, help="Rate of --images; default 30.")
def track_command(
    what: str,
    images: Path | None,
    video: Path | None,
    model: Path | None,
    camera: Path | None,
    init: Path | None,
    rate_hz: float,
    **options: Any,
) -> None:
    """Run the trackers of the suite WHAT, rendering what is missing; or the tracker WHAT on real images."""
    source = images or video
    if source is None:
        sys.exit(bring_up_to("track", what, **options))
    if images and video:
        raise UserError("give --images or --video, not both")
    if model is None or camera is None or init is None or options["out"] is None:
        raise UserError("tracking real images needs --model, --camera, --init and --out")
    from bench.verbs import track_real

    track_real(what, source, model, camera, init, options["out"], rate_hz)


suite_command("score", "Score the results of SUITE, making what is missing.")
suite_command("report", "Write the report of SUITE, making what is missing.")


@main.command("verify")
@click.argument("folders", type=FILE, nargs=-1, required=True)
@click.option("--against", type=FILE, help="Sequence rendered again, compared by tolerance where hashes differ.")
def verify_command(folders: tuple[Path, ...], against: Path | None) -> None:
    """Check sequence FOLDERS against their manifests, or one against its rendering elsewhere."""
    from scenes.verify import compare, verify

    if against is not None and len(folders) != 1:
        raise UserError("--against compares one folder with another")
    verdicts = [compare(folder, against) if against else verify(folder) for folder in folders]
    for verdict in verdicts:
        click.echo(
            f"{verdict.folder}: {'ok' if verdict.ok else 'DIFFERS'} ({verdict.files} files, by {verdict.method})"
        )
        for problem in verdict.problems:
            click.echo(f"  {problem}")
    sys.exit(0 if all(verdict.ok for verdict in verdicts) else 1)


@main.command("export")
@click.argument("sequence", type=FILE)
@click.option("--format", "form", type=click.Choice(["euroc", "tum", "kitti", "bop", "video"]), required=True)
@click.option("--out", type=FILE, required=True, help="Folder that is made.")
def export_command(sequence: Path, form: str, out: Path) -> None:
    """Write the folder SEQUENCE in the form of another tool."""
    from scenes.exports import export
    from scenes.sequence import Sequence

    export(Sequence.load(sequence), form, out)
    click.echo(out)


@main.command("calibrate")
@click.argument("sources", type=FILE, nargs=-1, required=True)
@click.option("--board", default="7x8", show_default=True, metavar="COLUMNSxROWS", help="Inner corners of the board.")
@click.option("--square-m", type=click.FloatRange(0, min_open=True), default=0.025, show_default=True)
@click.option("--model", type=click.Choice(["radtan", "equidistant"]), default="radtan", show_default=True)
@click.option("--out", type=FILE, default=Path("camera.toml"), show_default=True)
def calibrate_command(sources: tuple[Path, ...], board: str, square_m: float, model: Any, out: Path) -> None:
    """Find K and distortion of a camera from images, folders or videos of a checkerboard."""
    from scenes.calibrate import calibrate, write_coverage

    columns, _, rows = board.partition("x")
    if not (columns.isdigit() and rows.isdigit()):
        raise UserError(f"--board {board!r}: write the numbers of inner corners as 7x8")
    found = calibrate(list(sources), (int(columns), int(rows)), square_m, model=model)
    found.camera.save(out)
    write_coverage(found, out.with_suffix(".png"))
    click.echo(f"{len(found.used)} images used, {len(found.unused)} not; reprojection error {found.rms_px:.3f} px")
    click.echo(f"corners in {100 * found.covered:.0f} % of the image: {out.with_suffix('.png')}")
    click.echo(out)


@main.command("pick")
@click.option("--images", type=FILE, help="Folder of images; points are picked on the first by name.")
@click.option("--video", type=FILE, help="Video; points are picked on its first frame.")
@click.option("--model", type=FILE, required=True, help="Structure: .obj .stl .ply .glb .cao ...")
@click.option("--camera", type=FILE, required=True, help="camera.toml")
@click.option("--out", type=FILE, default=Path("init.toml"), show_default=True)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of this computer; default: a free one.")
@click.option("--browser/--no-browser", default=True, help="Open the page at once; default: yes.")
def pick_command(
    images: Path | None, video: Path | None, model: Path, camera: Path, out: Path, port: int, browser: bool
) -> None:
    """Pick points of the model on the first image, in a page of your browser, for the first pose."""
    source = images or video
    if source is None or (images and video):
        raise UserError("give --images or --video")
    from bench.pick import pick

    pick(source, model, camera, out, port=port, browser=browser)


@main.command("list")
def list_command() -> None:
    """Show the suites and every plug-in by kind."""
    from bench.inventory import inventory

    click.echo(inventory())


def margin_options(command: Any) -> Any:
    """The margins that `gate` and `compare` decide by."""
    for name, default, about in (
        ("--resolution", "10%", "A pass must exclude a change so large."),
        ("--coverage-margin", "1%", "Tolerated loss of coverage, in shares of all frames."),
        ("--latency-margin", "5%", "Tolerated growth of latency."),
        ("--margin", "1%", "Tolerated growth of errors."),
    ):
        command = click.option(name, default=default, show_default=True, callback=share, help=about)(command)
    return command


def share(ctx: click.Context, parameter: click.Parameter, text: str) -> float:
    """A share from `5%` or `0.05`."""
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < 10.0:
        raise click.BadParameter(f"{text!r} is no share: write 5% or 0.05")
    return value


@main.command("gate")
@click.argument("results", type=click.Path(path_type=Path))
@click.option(
    "--baseline",
    type=click.Path(path_type=Path),
    required=True,
    help="Folder of a run on the same frames, or a file made by --update.",
)
@click.option("--update", is_flag=True, help="Make the baseline, a file, anew from RESULTS; compare nothing.")
@margin_options
@click.option("--out", type=click.Path(path_type=Path), help="Folder of gate.json, .xml, .md; default: RESULTS/gate.")
def gate_command(
    results: Path,
    baseline: Path,
    update: bool,
    margin: float,
    latency_margin: float,
    coverage_margin: float,
    resolution: float,
    out: Path | None,
) -> None:
    """Decide whether RESULTS are worse than a baseline: exit code 0 pass, 1 fail, 3 inconclusive."""
    if update:
        from bench.gate_baseline import write_baseline
        from bench.gate_scores import read_side

        write_baseline(read_side(results), baseline)
        click.echo(baseline)
        return
    from bench.gate import Margins
    from bench.gate_reports import pronounce

    margins = Margins(error=margin, latency=latency_margin, coverage=coverage_margin, resolution=resolution)
    sys.exit(pronounce(results, baseline, margins, out or results / "gate"))


@main.command("speed")
@click.option("--only", default="", help="Only benchmarks whose name holds this (an expression of pytest's -k).")
@click.option("--save", type=click.Path(path_type=Path), help="File for pytest-benchmark's own JSON.")
def speed_command(only: str, save: Path | None) -> None:
    """Run the benchmarks and print their times against the goals."""
    from bench.speed_table import speed

    sys.exit(speed(only, save))


@main.command("compare")
@click.argument("base_ref")
@click.argument("head_ref", default=".")
@click.option("--suite", default="gate", show_default=True, help="Suite that both versions' trackers run on.")
@click.option("--repeats", type=click.IntRange(1), default=3, show_default=True, help="Runs of each, for the latency.")
@click.option(
    "--jobs", type=click.IntRange(1), default=os.cpu_count(), help="Processes that render; default: all cores."
)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/compare"), show_default=True)
@margin_options
def compare_command(
    base_ref: str,
    head_ref: str,
    suite: str,
    repeats: int,
    jobs: int,
    out: Path,
    margin: float,
    latency_margin: float,
    coverage_margin: float,
    resolution: float,
) -> None:
    """Run two versions of this git repository on the same frames and let the gate decide; `.` is the working tree."""
    from bench.compare import compare
    from bench.gate import Margins

    margins = Margins(error=margin, latency=latency_margin, coverage=coverage_margin, resolution=resolution)
    sys.exit(compare((base_ref, head_ref), suite, out, repeats, margins, jobs))


@main.group("peers")
def peers_group() -> None:
    """Trackers of others to compare with: ViSP's, and OpenCV contrib's."""


@peers_group.command("list")
def peers_list_command() -> None:
    """Show which peers are set up."""
    from bench.peers.registry import status

    click.echo("\n".join(status()))


@peers_group.command("setup")
@click.argument("name")
def peers_setup_command(name: str) -> None:
    """Set up the peer NAME, with what it needs, for this user."""
    from bench.peers.registry import setup

    click.echo(setup(name))


@main.command("check")
@click.argument("tracker", type=click.Path(path_type=Path))
@click.option("--keep", type=click.Path(path_type=Path), default=Path("out/check"), help="Folder of a faulty job.")
def check_command(tracker: Path, keep: Path) -> None:
    """Try TRACKER, a TOML file with the table of one tracker, on a tiny sequence; explain every fault."""
    from bench.check import check
    from bench.config import load_tracker

    line = ""
    for line in check(load_tracker(tracker), keep):
        click.echo(line)
    sys.exit(1 if line.startswith("faulty") else 0)


ALIGNMENTS = ["none", "se3", "sim3", "yaw", "scale", "origin", "origin-scale"]
UNITS = ["frames", "m", "deg", "rad", "s"]
ASSOCIATIONS = ["one-to-one", "evo", "evo-interpolated"]
FORMATS = ["tum", "euroc", "kitti"]
MODES = ["uavbench", "evo", "tum", "kitti", "rpg"]


@main.command("evaluate")
@click.argument("reference", type=click.Path(path_type=Path))
@click.argument("estimate", type=click.Path(path_type=Path))
@click.option("--align", type=click.Choice(ALIGNMENTS), help="Alignment of the estimate; default: none.")
@click.option("--delta", type=float, help="Length of the stretches of the RPE; default: 1.")
@click.option("--unit", type=click.Choice(UNITS), help="Unit of --delta; default: frames.")
@click.option("--all-pairs/--consecutive", default=None, help="Stretches of the RPE; default: consecutive.")
@click.option("--pairs-from", type=click.Choice(["reference", "estimate"]), help="Whose deltas choose them.")
@click.option("--t-offset", "t_offset_s", type=float, default=0.0, help="Added to the estimate's stamps, s.")
@click.option("--max-diff", "max_difference_s", type=float, help="Largest difference of paired stamps, s.")
@click.option("--association", type=click.Choice(ASSOCIATIONS), help="How stamps are paired; default: one-to-one.")
@click.option("--mode", type=click.Choice(MODES), default="uavbench", help="Conventions of another tool.")
@click.option("--reference-format", type=click.Choice(FORMATS), help="Default: guessed, and said.")
@click.option("--estimate-format", type=click.Choice(FORMATS), help="Default: guessed, and said.")
@click.option("--plot", type=click.Path(path_type=Path), help="Also draw paths and errors into a .pdf or .png file.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def evaluate_command(reference: Path, estimate: Path, as_json: bool, **options: Any) -> None:
    """Score the trajectory file ESTIMATE against REFERENCE: ATE, RPE and coverage."""
    import json

    from reports.evaluate import evaluate_files

    found = evaluate_files(reference, estimate, **options)
    click.echo(json.dumps(found.to_json(), indent=1) if as_json else found.text(), nl=as_json)


@main.command("schema")
def schema_command() -> None:
    """Print the JSON Schema of a suite's TOML file, for editors."""
    from bench.verbs import schema

    click.echo(schema())


if __name__ == "__main__":
    main()
