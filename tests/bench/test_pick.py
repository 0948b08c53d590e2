"""Picking points by hand: what the page's server solves, saves and refuses."""

import json
import queue
import threading
import urllib.error
import urllib.request
from contextlib import contextmanager

import numpy as np
import pytest

from bench.check import TRIAL
from bench.pick import Picking, serve
from scenes.sequence import Sequence
from tracker.initial_pose import read_init
from trajectories.errors import UserError


@pytest.fixture
def sequence():
    return Sequence.load(TRIAL)


@pytest.fixture
def picking(sequence, tmp_path):
    return Picking(sequence.image(0), sequence.camera, sequence.structure, tmp_path / "init.toml")


def true_pairs(picking, sequence, count=5):
    pose = sequence.true_cam_from_world(0)
    pixels = sequence.camera.project(pose.transform(picking.corners))
    return [{"corner": k, "image_px": pixels[k].tolist()} for k in range(count)]


@contextmanager
def served(picking):
    """Address of the picking's page; the server has ended at the end."""
    said: queue.Queue[str] = queue.Queue()
    thread = threading.Thread(target=serve, args=(picking, said.put), daemon=True)
    thread.start()
    yield said.get(timeout=20)
    thread.join(timeout=20)
    assert not thread.is_alive()


def post(address, verb, body):
    with urllib.request.urlopen(f"{address}/{verb}", data=json.dumps(body).encode(), timeout=20) as answer:
        return json.load(answer)


def test_true_corners_give_the_true_pose_and_the_model_on_it(picking, sequence):
    solved = picking.solve(true_pairs(picking, sequence))
    assert solved["rms_px"] < 1e-4
    ends = np.array([line[0] for line in solved["lines"]])
    corners = sequence.camera.project(sequence.true_cam_from_world(0).transform(picking.corners))
    assert np.linalg.norm(ends[:, None] - corners[None], axis=2).min(axis=1).max() < 0.1


def test_what_is_saved_is_read_as_a_first_pose(picking, sequence):
    with served(picking) as address:
        pairs = true_pairs(picking, sequence)
        assert post(address, "solve", pairs)["rms_px"] < 1e-4
        assert "error" in post(address, "solve", pairs[:3])
        assert "error" in post(address, "save", [{"corner": -1, "image_px": [0, 0]}] * 5)
        assert "error" in post(address, "save", {"no": "list"})
        assert not picking.out.exists()
        assert post(address, "save", pairs)["saved"] == str(picking.out)
    read = read_init(picking.out, sequence.camera)
    difference = (read @ sequence.true_cam_from_world(0).inverse()).log()
    assert np.abs(difference).max() < 1e-3


def test_only_who_has_the_address_is_answered(picking, sequence):
    with served(picking) as address:
        root = address.rsplit("/", 1)[0]
        assert root.startswith("http://127.0.0.1:")
        for path in ("/", "/init.toml", "/wrong/image.png"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(root + path, timeout=20)
        with pytest.raises(urllib.error.HTTPError, match="404"):
            post(root + "/wrong", "save", true_pairs(picking, sequence))
        with urllib.request.urlopen(address + "/image.png", timeout=20) as image:
            assert image.read().startswith(b"\x89PNG")
        post(address, "save", true_pairs(picking, sequence))


@pytest.mark.parametrize(
    "pairs",
    [
        [],
        [{"corner": 99, "image_px": [0, 0]}] * 5,
        [{"corner": 0}] * 5,
        [{"corner": 0, "image_px": ["a", 0]}] * 5,
        [{"corner": 0, "image_px": [float("nan"), 0]}] * 5,
        [{"corner": 0, "image_px": [10, 10]}] * 5,
        [None] * 5,
    ],
)
def test_pairs_that_give_no_pose_are_refused(picking, pairs):
    with pytest.raises(UserError):
        picking.solve(pairs)
