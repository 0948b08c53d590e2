"""A product of each kind that a command writes, and the commands that may replace it by one of the same kind."""

import json
import shutil
from dataclasses import dataclass

from tests.contracts.commands import invoke
from uavbench.bench.challenge.organizer import Challenge
from uavbench.bench.challenge.pack import TRUTH
from uavbench.bench.challenge.package import PACKAGE
from uavbench.bench.config.suite import load_suite
from uavbench.bench.filming.files import MARKER as FILMED
from uavbench.bench.gate.compare import TIMING
from uavbench.bench.history.measuring import BISECTION
from uavbench.bench.pick.server import POINTS
from uavbench.bench.reference import REFERENCE
from uavbench.bench.runner.output_folder import suite_folder
from uavbench.bench.speed.table import BENCHMARKS
from uavbench.bench.twin.twin import MARKER as TWIN
from uavbench.reports.closed_loop.files import MARKER as FLIGHT
from uavbench.reports.report import ReportInputs, write_scores
from uavbench.reports.scoring.score import score
from uavbench.scenes.calibration import CALIBRATION
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import RENDERED, Sequence
from uavbench.scenes.scans.planar_files import PLANAR
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.images.recorded_sequence import RECORDED
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.files.writing import new_folder, write_text

SUITES = frozenset({"run", "render", "track", "score", "report", "fly", "compare", "bisect"})
"""Commands that write the results of a suite."""


@dataclass(frozen=True)
class Product:
    """Name of a file or folder, and the commands that may replace it."""

    name: str
    by: frozenset[str]


def product(name, *by):
    return Product(name, frozenset(by))


FILES = [
    product("camera.toml", "calibrate"), product("init.toml", "pick"), product("speed.json", "speed"),
    product("errors.pdf", "evaluate"), product("picture.png", "evaluate"), product("score.json", "score-submission"),
    product("baseline.json", "gate"), product("history.json", "gate"), product("commands.md"),
    product("table.md", "tables"), product("planar.obj", "planes"),
]  # fmt: skip
FOLDERS = [
    product("suite", *SUITES), product("study", "sensitivity"), product("truth", "pack"), product("package", "pack"),
    product("sequence"), product("recording"), product("twin", "twin"), product("flight"), product("video"),
    product("estimates", "track"), product("export"), product("kept", "check"),
    product("evaluation", "evaluate"), product("verdict", "gate"), product("history", "history"),
    product("leaderboard", "leaderboard"), product("bisection", "bisect"), product("comparison", "compare"),
]  # fmt: skip
PRODUCTS = FILES + FOLDERS


def make(inputs, folder):
    """Write all products into a folder, by the commands where these are quick, else by what they write with."""
    sequence, suite = Sequence.load(inputs / "trial"), load_suite(inputs / "small.toml")
    results = track_sequence(Hold(), sequence, rate_hz=5.0, seed=0)
    Camera.load(inputs / "trial" / "camera.toml").save(folder / "camera.toml", kind=CALIBRATION)
    write_text(folder / "planar.obj", "# no faces\n", kind=PLANAR)
    write_text(folder / "init.toml", "points = []\n", kind=POINTS)
    write_text(folder / "commands.md", "# Commands\n", kind=REFERENCE)
    for name, kind in (("speed", BENCHMARKS), ("bisection/bisect", BISECTION), ("comparison/head/timing", TIMING)):
        write_text(folder / f"{name}.json", json.dumps({"a": 1}, indent=1) + "\n", kind=kind)
    for name, marker in {"sequence": RENDERED, "recording": RECORDED, "twin": TWIN, "flight": FLIGHT,
                         "video": FILMED, "package": PACKAGE}.items():  # fmt: skip
        with new_folder(folder / name, marker) as new:
            shutil.copytree(inputs / "trial", new, dirs_exist_ok=True)
    results.save(folder / "estimates")
    with suite_folder(folder / "suite", suite):
        results.save(folder / "suite" / "results" / "box-s0" / "hold@5hz")
        write_scores(folder / "suite", ReportInputs("small", []), [score(sequence, results)])
    with suite_folder(folder / "study", suite, kind="sensitivity study"):
        write_text(folder / "study" / "sensitivity.md", "none")
    with suite_folder(folder / "truth", suite, kind=TRUTH):
        Challenge("c", 5.0, {}).save(folder / "truth")
    shutil.copy(inputs / "history.json", folder)
    files, runs = [inputs / "a.tum", inputs / "b.tum"], inputs / "results"
    for call in (
        ["evaluate", *files, "--plot", folder / "errors.pdf"],
        ["evaluate", *files, "--plot", folder / "picture.png"],
        ["evaluate", *files, "--out", folder / "evaluation"],
        ["gate", runs, "--baseline", folder / "baseline.json", "--update"],
        ["gate", runs, "--baseline", runs, "--out", folder / "verdict"],
        ["history", inputs / "history.json", "--out", folder / "history"],
        ["leaderboard", inputs / "score.json", "--out", folder / "leaderboard"],
        ["score-submission", inputs / "organizer", inputs / "team", "--out", folder / "score.json"],
        ["export", inputs / "trial", "--format", "tum", "--out", folder / "export"],
        ["tables", inputs / "report", "--out", folder / "table.md"],
        ["check", inputs / "bad.toml", "--keep", folder / "kept"],
    ):
        result = invoke(call, folder)
        made = next(path for path in call if getattr(path, "parent", None) == folder)
        assert made.exists(), f"{call}: {result.output}"
