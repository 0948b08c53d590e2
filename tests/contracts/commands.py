"""Every command that writes, as it is called, and what is there before and after."""

from pathlib import Path

from click.testing import CliRunner

from uavbench.bench.cli.files import EXPORTS
from uavbench.bench.cli.main import main


def calls(inputs, target):
    """Every command that writes, told to write to `target`."""
    suite, trial, images = inputs / "small.toml", inputs / "trial", inputs / "images"
    real = ["--images", images, "--model", trial / "model.obj", "--camera", trial / "camera.toml"]
    trajectories, results = [inputs / "a.tum", inputs / "b.tum"], inputs / "results"
    return {
        **{verb: [[verb, suite, "--out", target, "--jobs", 1]] for verb in ("run", "render", "score", "report")},
        "fly": [["fly", inputs / "flown.toml", "--out", target, "--jobs", 1]],
        "track": [
            ["track", suite, "--out", target],
            ["track", "hold", *real, "--init", inputs / "init.toml", "--out", target],
        ],
        "twin": [["twin", inputs / "rendered", "--out", target]],
        "import": [["import", *real, "--ground-truth", trial / "groundtruth.csv", "--out", target]],
        "export": [["export", trial, "--format", form, "--out", target] for form in EXPORTS],
        "calibrate": [["calibrate", inputs / "board.png", "--out", target]],
        "planes": [
            ["planes", inputs / "scan.ply", "--out", target],
            ["planes", inputs / "scan.ply", "--out", target.with_suffix(".obj")],
        ],
        "pick": [["pick", *real, "--no-browser", "--out", target]],
        "evaluate": [
            ["evaluate", *trajectories, "--plot", target],
            ["evaluate", *trajectories, "--plot", target.with_suffix(".pdf")],
            ["evaluate", *trajectories, "--plot", target / "index.pdf"],
            ["evaluate", *trajectories, "--out", target],
        ],
        "tables": [
            ["tables", inputs / "report", "--out", target],
            ["tables", inputs / "report", "--out", target.with_suffix(".csv")],
            ["tables", inputs / "report", "--columns", "coverage", "--out", target / "thesis.tex"],
        ],
        "pack": [
            ["pack", suite, "--without-truth", "--out", target, "--truth", "truth"],
            ["pack", suite, "--without-truth", "--out", "package", "--truth", target],
            ["pack", suite, "--without-truth", "--out", "package", "--truth", "truth", "--secret", target],
        ],
        "score-submission": [["score-submission", inputs / "organizer", inputs / "team", "--out", target]],
        "leaderboard": [["leaderboard", inputs / "score.json", "--out", target]],
        "check": [["check", inputs / "bad.toml", "--keep", target]],
        "gate": [
            ["gate", results, "--baseline", target, "--update"],
            ["gate", results, "--baseline", results, "--out", target],
            ["gate", results, "--record", target, "--commit", "2e4b"],
        ],
        "history": [["history", inputs / "history.json", "--out", target]],
        "bisect": [["bisect", "HEAD", "HEAD", "--suite", suite, "--out", target]],
        "compare": [["compare", "HEAD", "HEAD", "--suite", suite, "--out", target]],
        "speed": [["speed", "--only", "none", "--save", target]],
        "sensitivity": [
            ["sensitivity", inputs / "studied" / "small.toml", "--tracker", "rapid", "--jobs", 1, "--out", target]
        ],
        "third-party setup": [["third-party", "setup", "visp"], ["third-party", "setup", "opencv-rapid"]],
    }


COMMANDS = sorted(calls(Path("inputs"), Path("target")))


def snapshot(folder):
    def told(path):
        if path.is_symlink():
            return str(path.readlink())
        return path.read_bytes() if path.is_file() else path.lstat().st_mode

    return {path.relative_to(folder).as_posix(): told(path) for path in sorted(folder.rglob("*"))}


def invoke(arguments, third_party):
    environment = {"UAVBENCH_THIRD_PARTY": str(third_party)}
    return CliRunner().invoke(main, [str(a) for a in arguments], env=environment)


def assert_kept(folder, before, result):
    after = snapshot(folder)
    assert {name: after.get(name) for name in before} == before, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert "Traceback" not in result.output
    assert not [name for name in set(after) - set(before) if "-uavbench-" in name]
