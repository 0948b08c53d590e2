"""The commands over single files and folders: verify, import, export, twin, calibrate, pick, evaluate."""

import sys
import warnings
from pathlib import Path
from typing import Any

import click

from uavbench.bench.cli.values import FILE
from uavbench.bench.said import say
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.files.folders import try_place
from uavbench.trajectories.files.origin import refuse_foreign_file, refuse_within_whole

EXPORTS = ["euroc", "kalibr", "tum", "kitti", "bop", "video", "mcap", "rosbag2", "colmap", "transforms"]
RERUN = "rerun"
"""The format of a tracker's run; those of EXPORTS are of sequences."""


@click.command("verify")
@click.argument("folders", type=FILE, nargs=-1, required=True)
@click.option("--against", type=FILE, help="Sequence rendered again, compared by tolerance where hashes differ.")
def verify_command(folders: tuple[Path, ...], against: Path | None) -> None:
    """Check sequence FOLDERS against their manifests, or one against its rendering elsewhere."""
    from uavbench.scenes.dataset.verify import compare, verify

    if against is not None and len(folders) != 1:
        raise UserError("--against compares one folder with another")
    verdicts = [compare(folder, against) if against else verify(folder) for folder in folders]
    for verdict in verdicts:
        say(f"{verdict.folder}: {'ok' if verdict.ok else 'DIFFERS'} ({verdict.files} files, by {verdict.method})")
        for problem in verdict.problems:
            say(f"  {problem}")
    sys.exit(0 if all(verdict.ok for verdict in verdicts) else 1)


@click.command("import")
@click.option("--images", type=FILE, required=True, help="Folder of images, taken in the order of their names.")
@click.option("--model", type=FILE, required=True, help="Structure: .obj .stl .ply .glb .cao ...")
@click.option("--camera", type=FILE, required=True, help="camera.toml")
@click.option(
    "--ground-truth", type=FILE, required=True, help="Poses of the camera in the model's frame, as for evaluate."
)
@click.option(
    "--cam-from-body", type=FILE, help="TOML file with the matrix cam_from_body, for poses that are of a body."
)
@click.option("--rate-hz", type=click.FloatRange(0, min_open=True), help="Of images without times of their own.")
@click.option("--out", type=FILE, required=True, help="Folder of the sequence.")
def import_command(images: Path, cam_from_body: Path | None, out: Path, **given: Any) -> None:
    """Make a sequence folder of images of your own, whose poses are known."""
    from uavbench.bench.own_images.import_sequence import import_sequence, read_mount

    mount = read_mount(cam_from_body) if cam_from_body else None
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # the doubts, said below
        made = import_sequence(out, images, cam_from_body=mount, **given)
    for doubt in made.info["doubts"]:
        say(f"doubt: {doubt}", err=True)
    say(f"{len(made)} images at {made.info['rate_hz']:g} Hz", err=True)
    say(out)


@click.command("export")
@click.argument("folder", type=FILE)
@click.option(
    "--format",
    "form",
    type=click.Choice([*EXPORTS, RERUN]),
    required=True,
    metavar="FORMAT",
    help=f"One of {', '.join([*EXPORTS, RERUN])}.",
)
@click.option("--out", type=FILE, required=True, help="Folder to create; of rerun, a file .rrd.")
@click.option("--undistort", is_flag=True, help="Remove the lens distortion from the images.")
@click.option("--camera", metavar="NAME", help="Export this camera alone, in place of the main one.")
@click.option("--images", type=click.Choice(["both", "raw", "compressed"]), help="Messages of a bag; default: both.")
@click.option("--datum", metavar="LAT,LON,HEIGHT", help="Where on Earth a bag's world lies, deg and m.")
def export_command(folder: Path, form: str, out: Path, **options: Any) -> None:
    """Write the sequence in FOLDER in the format of another tool, and list what that format cannot represent.

    With --format rerun, FOLDER holds a tracker's results on a rendered sequence, as
    out/SUITE/results/SEQUENCE/TRACKER@15hz: write the run as a recording for the Rerun viewer.
    """
    if form == RERUN:
        export_run(folder, out, [f"--{name}" for name, value in options.items() if value])
    else:
        export_sequence(folder, form, out, **options)
    say(out)


def export_sequence(
    folder: Path, form: str, out: Path, undistort: bool, camera: str | None, images: str | None, datum: str | None
) -> None:
    """Export a sequence, and print what the format does not hold."""
    from uavbench.scenes.dataset.sequence import Sequence
    from uavbench.scenes.exports.registry import export
    from uavbench.scenes.exports.ros.geodetic import Datum

    given: dict[str, Any] = {"images": images, "datum": Datum.parse(datum) if datum else None}
    settings = {name: value for name, value in given.items() if value is not None}
    whole = Sequence.load(folder)
    if camera is not None and camera not in whole.cameras:
        raise unknown_name(f"camera of {folder}", camera, list(whole.cameras))
    shown = whole if camera is None else whole.cameras[camera]
    for line in export(shown, form, out, undistort=undistort, **settings):
        say(f"not held: {line}", err=True)


def export_run(folder: Path, out: Path, unused: list[str]) -> None:
    """Write a recording of a tracker's run for Rerun; unused: options that are for sequences only."""
    from uavbench.reports.page.rerun_export import write_rrd
    from uavbench.reports.run_folder import load_run

    if unused:
        raise UserError(f"{', '.join(unused)}: only for sequences, in {', '.join(EXPORTS)}; leave it out")
    if out.suffix != ".rrd":
        raise UserError(f"--out {out}: the viewer knows its recordings by their suffix; name a file such as run.rrd")
    refuse_within_whole(out)
    refuse_foreign_file(out)
    try_place(out)
    write_rrd(load_run(folder), out)


@click.command("twin")
@click.argument("sequence", type=FILE)
@click.option("--out", type=FILE, required=True, help="Folder of the twin.")
@click.option("--every", type=click.IntRange(1), default=1, show_default=True, help="Render every N-th frame.")
@click.option("--samples", type=click.IntRange(1), default=64, show_default=True, help="Paths per pixel.")
@click.option("--suite", help="Then run the trackers of this suite on both, and print how they rank.")
def twin_command(sequence: Path, out: Path, every: int, samples: int, suite: str | None) -> None:
    """Render the folder SEQUENCE again by path tracing, with Blender, into a sequence folder of its own."""
    from tqdm import tqdm

    from uavbench.bench.config.suite import load_suite
    from uavbench.bench.config.suite_files import suite_file
    from uavbench.bench.twin.ranking import table
    from uavbench.bench.twin.twin import Tracing, left_out, make_twin
    from uavbench.scenes.dataset.sequence import Sequence

    trackers = load_suite(suite_file(suite)).trackers if suite else {}
    with tqdm(unit="frame", disable=None) as bar:

        def on_frame(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        make_twin(sequence, out, Tracing(every, samples), on_frame)
    given = Sequence.load(sequence)
    if missing := left_out(given, every):
        say(f"not in the twin: {missing}", err=True)
    say(out)
    for line in table(trackers, given, Sequence.load(out)) if suite else ():
        say(line)


@click.command("calibrate")
@click.argument("sources", type=FILE, nargs=-1, required=True)
@click.option("--board", default="7x8", show_default=True, metavar="COLUMNSxROWS", help="Inner corners of the board.")
@click.option("--square-m", type=click.FloatRange(0, min_open=True), default=0.025, show_default=True)
@click.option("--model", type=click.Choice(["radtan", "equidistant"]), default="radtan", show_default=True)
@click.option("--bits", type=click.IntRange(8, 16), help="Bits of the camera, of images with 16 bits per sample.")
@click.option("--out", type=FILE, default=Path("camera.toml"), show_default=True)
def calibrate_command(
    sources: tuple[Path, ...], board: str, square_m: float, model: Any, bits: int | None, out: Path
) -> None:
    """Find K and distortion of a camera from images, folders or videos of a checkerboard.

    Of a folder or video at most 60 pictures are taken, evenly spread.
    """
    from uavbench.scenes.calibration import CALIBRATION, calibrate, write_coverage

    columns, _, rows = board.partition("x")
    if not (columns.isdecimal() and rows.isdecimal()):
        raise UserError(f"--board {board!r}: write the numbers of inner corners as 7x8")
    if out.with_suffix(".png") == out:
        raise UserError(f"--out {out}: the picture of the corners gets this name; name a file such as camera.toml")
    for path in (out, out.with_suffix(".png")):
        refuse_foreign_file(path, CALIBRATION)
        try_place(path)
    found = calibrate(list(sources), (int(columns), int(rows)), square_m, model=model, bits=bits or 0)
    found.camera.save(out, kind=CALIBRATION)
    write_coverage(found, out.with_suffix(".png"))
    say(f"{len(found.used)} images used, {len(found.unused)} without the whole board")
    say(f"reprojection error {found.rms_px:.3f} px")
    say(f"corners in {100 * found.covered:.0f} % of the image: {out.with_suffix('.png')}")
    say(out)


@click.command("pick")
@click.option("--images", type=FILE, help="Folder of images; points are picked on the first by name.")
@click.option("--video", type=FILE, help="Video; points are picked on its first frame.")
@click.option("--model", type=FILE, required=True, help="Structure: .obj .stl .ply .glb .cao ...")
@click.option("--camera", type=FILE, required=True, help="camera.toml")
@click.option("--out", type=FILE, default=Path("init.toml"), show_default=True)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page; default: a free one.")
@click.option("--browser/--no-browser", default=True, help="Open the page at once; default: yes.")
def pick_command(
    images: Path | None, video: Path | None, model: Path, camera: Path, out: Path, port: int, browser: bool
) -> None:
    """Pick points of the model on the first image, in a page of your browser, for the initial pose."""
    source = images or video
    if source is None or (images and video):
        raise UserError("give --images or --video")
    from uavbench.bench.pick.server import pick

    pick(source, model, camera, out, port=port, browser=browser)


ALIGNMENTS = ["none", "se3", "sim3", "yaw", "scale", "origin", "origin-scale"]
UNITS = ["frames", "m", "deg", "rad", "s"]
ASSOCIATIONS = ["one-to-one", "evo", "evo-interpolated"]
FORMATS = ["tum", "euroc", "kitti", "uavbench", "bag"]
MODES = ["uavbench", "evo", "tum", "kitti", "rpg"]


@click.command("evaluate")
@click.argument("reference", type=FILE)
@click.argument("estimates", type=FILE, nargs=-1)
@click.option("--group", "groups", multiple=True, metavar="NAME=PATTERN", help="Files that are runs of one tracker.")
@click.option("--out", type=FILE, help="Folder for a page, figures and tables of many runs.")
@click.option("--align", type=click.Choice(ALIGNMENTS), help="Alignment of the estimate; default: none.")
@click.option("--delta", type=float, help="Pair interval of the RPE; default: 1.")
@click.option("--unit", type=click.Choice(UNITS), help="Unit of --delta; default: frames.")
@click.option("--all-pairs/--consecutive", default=None, help="Pairs of the RPE; default: consecutive.")
@click.option("--pairs-from", type=click.Choice(["reference", "estimate"]), help="Whose path or rotation is measured.")
@click.option("--t-offset", "t_offset_s", type=float, default=0.0, help="Added to the estimate's stamps, s.")
@click.option("--max-diff", "max_difference_s", type=float, help="Largest difference of paired stamps, s.")
@click.option("--association", type=click.Choice(ASSOCIATIONS), help="How stamps are paired; default: one-to-one.")
@click.option("--mode", type=click.Choice(MODES), default="uavbench", help="Conventions of another tool.")
@click.option("--reference-format", type=click.Choice(FORMATS), help="Default: recognized, and reported.")
@click.option("--estimate-format", type=click.Choice(FORMATS), help="Default: recognized, and reported.")
@click.option("--mount", type=FILE, help="Sequence folder by whose mount camera and body poses are converted.")
@click.option("--ignore-frames", is_flag=True, help="Compare even where the files declare different frames.")
@click.option("--plot", type=FILE, help="Also draw paths and errors into a .pdf or .png file.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def evaluate_command(
    reference: Path,
    estimates: tuple[Path, ...],
    groups: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Score trajectories ESTIMATES against REFERENCE: ATE, RPE and coverage; of several, mean, spread and tests.

    Each is a file of TUM, EuRoC, KITTI or uavbench's own form, a topic of a ROS 2 bag as bag.mcap:/odom or
    bag.mcap:/tf:world.base_link, or a folder of a sequence, an export or results. Several estimates are runs of one
    tracker, unless --group tells trackers apart: --group ORB='orb/run*.tum' --group VINS='vins/run*.tum'.
    """
    import json

    if len(estimates) == 1 and not groups and out is None:
        from uavbench.reports.evaluation.evaluate import evaluate_files

        found = evaluate_files(reference, estimates[0], **options)
        say(json.dumps(found.to_json(), indent=1) if as_json else found.text(), nl=as_json)
        return
    from uavbench.reports.many_runs.evaluate_many import evaluate_many
    from uavbench.reports.many_runs.groups import grouped
    from uavbench.reports.many_runs.results import ManyResults

    if out is not None:
        refuse_within_whole(out / "index.html")
        try_place(out / "index.html")  # before the runs are evaluated, which takes minutes
    results = ManyResults(evaluate_many(reference, grouped(estimates, groups), **options))
    say(json.dumps(results.to_json(), indent=1) if as_json else results.text(), nl=as_json)
    if out is not None:
        from uavbench.reports.many_runs.page import write_many

        say(write_many(out, results), err=as_json)
        if results.unshown:
            say(results.unshown, err=True)


COMMANDS: tuple[click.Command, ...] = (
    verify_command,
    import_command,
    export_command,
    twin_command,
    calibrate_command,
    pick_command,
    evaluate_command,
)
