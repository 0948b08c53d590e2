"""The `.rrd` export: a recording where the Rerun SDK is installed, one clear error where it is not."""

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

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
