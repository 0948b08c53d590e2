"""The `.rrd` export: a recording where the Rerun SDK is installed, one clear error where it is not."""

import importlib.util
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from uavbench.bench.cli.main import main
from uavbench.reports.page.rerun_export import write_rrd
from uavbench.reports.scoring.runs import ReportEntry, open_runs
from uavbench.trajectories.errors import UserError


def test_a_recording_or_a_clear_error(entries: list[ReportEntry], tmp_path: Path) -> None:
    entry = entries[2]
    run = open_runs([ReportEntry(entry.sequence, entry.results, entry.score)])[0]
    path = tmp_path / "run.rrd"
    if importlib.util.find_spec("rerun") is None:
        with pytest.raises(UserError, match=r"pip install 'uavbench\[rerun\]'"):
            write_rrd(run, path)
        assert list(tmp_path.iterdir()) == []
    else:
        write_rrd(run, path)
        assert path.read_bytes()[:4] == b"RRF2"


class Recorder:
    """A stand-in of the SDK that keeps what is logged, by entity and frame."""

    ViewCoordinates = SimpleNamespace(RIGHT_HAND_Z_UP="up", RDF="rdf")

    def __init__(self) -> None:
        self.logged: dict[str, dict[int, Any]] = {}
        self.frame = -1

    def __getattr__(self, archetype: str) -> Any:
        return lambda *given, **named: SimpleNamespace(archetype=archetype, given=given, **named)

    def RecordingStream(self, *_: Any, **__: Any) -> "Recorder":
        return self

    def save(self, path: str) -> None:
        Path(path).write_bytes(b"RRF2")

    def set_time(self, _: str, sequence: int | None = None, **__: Any) -> None:
        self.frame = self.frame if sequence is None else sequence

    def log(self, entity: str, what: Any, **_: Any) -> None:
        self.logged.setdefault(entity, {})[self.frame] = what

    def flush(self) -> None:
        pass

    disconnect = flush


def recorded(entry: ReportEntry, lost: set[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    run = open_runs([entry])[0]
    poses = [None if frame in lost else pose for frame, pose in enumerate(run.latest_pose)]
    monkeypatch.setitem(run.__dict__, "latest_pose", poses)
    sdk = Recorder()
    monkeypatch.setitem(sys.modules, "rerun", sdk)
    write_rrd(run, tmp_path / "run.rrd")
    return run, sdk.logged


def test_pixels_have_their_centres_at_halves_as_the_viewer_has_them(entries, tmp_path, monkeypatch) -> None:
    """Through the recorded camera, corners of the structure are on the recorded lines of its true edges."""
    run, logged = recorded(entries[2], set(), tmp_path, monkeypatch)
    camera = run.sequence.camera
    lens = logged["world/ground_truth/camera"], logged["world/ground_truth/camera/model_ground_truth"]
    for frame in (0, 20):
        at = logged["world/ground_truth"][frame]
        ends = np.concatenate(lens[1][frame].given[0])
        assert len(ends) > 6 and lens[0][frame].archetype == "EncodedImage"
        in_camera = (run.sequence.structure.vertices - at.translation) @ at.mat3x3
        homogeneous = in_camera @ logged["world/estimate/camera"][frame].image_from_camera.T
        corners = homogeneous[:, :2] / homogeneous[:, 2:]
        nearest = np.linalg.norm(ends[:, None] - corners[None], axis=2).min(axis=1)
        assert np.sort(nearest)[: len(ends) // 2].max() < 0.01
        middle = logged["world/estimate/camera"][frame].image_from_camera[:2, 2]
        np.testing.assert_allclose(middle, [camera.cx + 0.5, camera.cy + 0.5])
    assert np.array_equal(run.sequence.camera.K, camera.K)


def test_a_lost_frame_shows_no_model_of_the_frame_before(entries, tmp_path, monkeypatch) -> None:
    _, logged = recorded(entries[2], {7}, tmp_path, monkeypatch)
    for entity in ("world/estimate", "world/ground_truth/camera/model_estimate"):
        assert logged[entity][7].archetype == "Clear" and logged[entity][8].archetype != "Clear"
    assert logged["world/ground_truth/camera/model_ground_truth"][7].archetype == "LineStrips2D"


@pytest.fixture
def finished(entries: list[ReportEntry], tmp_path: Path) -> Path:
    """Results in the folder of a finished run, beside its sequence."""
    folder, entry = tmp_path / "out", entries[2]
    shutil.copytree(entry.sequence, folder / "sequences" / "arc")
    shutil.copytree(entry.results, folder / "results" / "arc" / entry.results.name)
    return folder / "results" / "arc" / entry.results.name


def export(folder: Path, out: Path, *options: str) -> Result:
    return CliRunner().invoke(main, ["export", str(folder), "--format", "rerun", "--out", str(out), *options])


def test_the_command_says_what_to_install_where_the_extra_is_absent(finished, tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    told = export(finished, tmp_path / "run.rrd")
    assert (told.exit_code, told.stdout) == (2, "")
    assert told.stderr == (
        "uavbench: writing .rrd needs the Rerun SDK, which is not installed: pip install 'uavbench[rerun]'\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_the_command_writes_the_recording_of_a_run(finished, tmp_path, monkeypatch) -> None:
    sdk, path = Recorder(), tmp_path / "run.rrd"
    monkeypatch.setitem(sys.modules, "rerun", sdk)
    done = export(finished, path)
    assert (done.exit_code, done.stdout, path.read_bytes()) == (0, f"{path}\n", b"RRF2")
    assert len(sdk.logged["world/ground_truth"]) == 45
    again = export(finished, path)
    assert again.exit_code == 2 and f"{path}: exists and is not an unmodified file of uavbench" in again.stderr


@pytest.mark.parametrize(
    ("what", "out", "options", "told"),
    [
        ("out/sequences/arc", "run.rrd", (), "is not a folder of a tracker's results on a sequence; give one that"),
        ("out/results/arc/none@15hz", "run.rrd", (), "is not a folder of a tracker's results on a sequence"),
        ("", "run", (), "the viewer knows its recordings by their suffix; name a file such as run.rrd"),
        ("", "run.rrd", ("--undistort", "--camera", "right"), "--undistort, --camera: only for sequences, in euroc"),
    ],
)  # fmt: skip
def test_what_is_no_run_and_no_recording_is_told(finished, tmp_path, monkeypatch, what, out, options, told) -> None:
    monkeypatch.setitem(sys.modules, "rerun", Recorder())
    given = export(tmp_path / what if what else finished, tmp_path / out, *options)
    assert given.exit_code == 2 and told in given.stderr and given.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_recording_is_not_put_among_the_results(finished, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", Recorder())
    told = export(finished, finished / "run.rrd")
    assert told.exit_code == 2 and "which uavbench wrote and checks as a whole" in told.stderr


def test_a_run_without_a_score_is_told(finished, tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", Recorder())
    (finished / "score.json").unlink()
    told = export(finished, tmp_path / "run.rrd")
    assert told.exit_code == 2
    assert f"has no score; create it with `uavbench score SUITE --out {tmp_path / 'out'}`" in told.stderr


def test_the_recording_has_the_cameras_of_the_run_at_their_times(finished, tmp_path) -> None:
    """Read by the SDK itself: translation, the columns of the rotation, and both timelines."""
    chunks = pytest.importorskip("rerun.chunk", reason="needs the extra uavbench[rerun], 0.41 or later to read")
    path = tmp_path / "run.rrd"
    assert export(finished, path).exit_code == 0
    rows: dict[str, dict[int, dict[str, Any]]] = {}
    for chunk in chunks.RrdReader(path).stream():
        for row in chunk.to_record_batch().to_pylist():
            rows.setdefault(chunk.entity_path, {}).setdefault(row.get("frame", -1), {}).update(row)
    folder = finished.parents[2]
    run = open_runs([ReportEntry(folder / "sequences" / "arc", finished, finished / "score.json")])[0]
    seconds = (run.sequence.stamps_ns - run.sequence.stamps_ns[0]) / 1e9
    for name, poses in (
        ("ground_truth", [run.sequence.true_cam_from_world(frame) for frame in range(45)]),
        ("estimate", run.latest_pose),
    ):
        cameras = rows[f"/world/{name}"]
        assert sorted(cameras) == list(range(45))
        for frame, pose in enumerate(poses):
            at, logged = pose.inverse(), cameras[frame]
            np.testing.assert_allclose(logged["time"].total_seconds(), seconds[frame], atol=1e-6)
            np.testing.assert_allclose(logged["Transform3D:translation"][0], at.translation, atol=1e-6)
            columns = np.reshape(logged["Transform3D:mat3x3"][0], (3, 3))
            np.testing.assert_allclose(columns.T, at.rotation, atol=1e-6)
    errors = rows["/error/position_cm"]
    logged_cm = [errors[frame]["Scalars:scalars"][0] for frame in run.errors.frames.tolist()]
    np.testing.assert_allclose(logged_cm, 100 * run.errors.translation_m)
    assert rows["/world/ground_truth/camera"][44]["EncodedImage:media_type"] == ["image/jpeg"]
    assert len(rows["/world/structure"][-1]["Mesh3D:vertex_positions"]) == len(run.sequence.structure.vertices)
