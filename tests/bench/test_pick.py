"""Picking points by hand: what the page's server solves, saves and refuses."""

import json
import queue
import socket
import struct
import threading
import urllib.error
import urllib.request
from contextlib import contextmanager

import numpy as np
import pytest

from tests.bench.process_trees import DEADLINE_S
from uavbench.bench.pick.server import Picking, serve
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.initialization import read_init
from uavbench.trajectories.errors import UserError


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
    yield said.get(timeout=DEADLINE_S)
    thread.join(timeout=DEADLINE_S)
    assert not thread.is_alive()


def post(address, verb, body):
    with urllib.request.urlopen(f"{address}/{verb}", data=json.dumps(body).encode(), timeout=DEADLINE_S) as answer:
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


def test_two_corners_that_were_exchanged_are_refused_as_their_reader_would(picking, sequence):
    pairs = true_pairs(picking, sequence, 6)
    pairs[2]["image_px"], pairs[4]["image_px"] = pairs[4]["image_px"], pairs[2]["image_px"]
    with pytest.raises(
        UserError, match=r"^points: at the pose that fits best, points\[2\] is 31.4 px from its pixel; check"
    ):
        picking.save(pairs)
    assert not list(picking.out.parent.iterdir())


def test_only_who_has_the_address_is_answered(picking, sequence):
    with served(picking) as address:
        root = address.rsplit("/", 1)[0]
        assert root.startswith("http://127.0.0.1:")
        for path in ("/", "/init.toml", "/wrong/image.png"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(root + path, timeout=DEADLINE_S)
        with pytest.raises(urllib.error.HTTPError, match="404"):
            post(root + "/wrong", "save", true_pairs(picking, sequence))
        with urllib.request.urlopen(address + "/image.png", timeout=DEADLINE_S) as image:
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


def raw(address, head, body=b""):
    """What the server answers to the bytes of a request: its status, and "" where it hangs up."""
    host, port = address.split("/")[2].split(":")
    with socket.create_connection((host, int(port)), timeout=DEADLINE_S) as connection:
        connection.sendall(head.encode() + b"\r\n\r\n" + body)
        connection.shutdown(socket.SHUT_WR)
        return connection.makefile("rb").read().split(b"\r\n")[0].decode()


@pytest.mark.parametrize(
    ("length", "status"),
    [("x", 411), ("-1", 411), ("", 411), ("1e3", 411), ("99999999", 413), ("9" * 30, 411), ("500", 400)],
)
def test_a_wrong_length_is_answered_and_the_server_goes_on(picking, sequence, length, status):
    with served(picking) as address:
        path, host = "/" + address.split("/", 3)[3], address.split("/")[2]
        head = f"POST {path}/save HTTP/1.1\r\nHost: {host}\r\nContent-Length: {length}"
        assert str(status) in raw(address, head, b"[]")
        post(address, "save", true_pairs(picking, sequence))


@pytest.mark.parametrize(
    "header", ["Host: evil.example:{port}", "Host: 127.0.0.1", "Origin: http://evil.example", "Origin: null"]
)
@pytest.mark.parametrize("request_line", ["GET {path}", "GET {path}/image.png", "POST {path}/save"])
def test_another_page_or_another_name_is_refused(picking, sequence, header, request_line):
    with served(picking) as address:
        path, host = "/" + address.split("/", 3)[3], address.split("/")[2]
        headers = [header.format(port=host.split(":")[1]), "Content-Length: 2"]
        headers += [f"Host: {host}"] if header.startswith("Origin") else []
        head = "\r\n".join([request_line.format(path=path) + " HTTP/1.1", *headers])
        assert "403" in raw(address, head, b"[]")
        assert not picking.out.exists()
        post(address, "save", true_pairs(picking, sequence))


def test_a_deep_body_is_an_error_and_not_the_end(picking, sequence):
    with served(picking) as address:
        path, host = "/" + address.split("/", 3)[3], address.split("/")[2]
        head = f"POST {path}/solve HTTP/1.1\r\nHost: {host}\r\nContent-Length: 90000"
        assert "200" in raw(address, head, b"[" * 90_000)
        post(address, "save", true_pairs(picking, sequence))


@pytest.mark.parametrize("number", ["1e999", "1" + "0" * 400, "1" + "0" * 30, "NaN"])
@pytest.mark.parametrize("pair", ['{{"corner": {}, "image_px": [1, 2]}}', '{{"corner": 0, "image_px": [{}, 2]}}'])
def test_no_number_of_a_pair_ends_its_request(picking, pair, number):
    with pytest.raises(UserError, match="pair"):
        picking.solve([json.loads(pair.format(number))])


def test_a_connection_that_is_cut_off_leaves_no_message_and_a_saved_page_ends(picking, sequence, capfd):
    with served(picking) as address:
        path, host = "/" + address.split("/", 3)[3], address.split("/")[2]
        pairs = json.dumps(true_pairs(picking, sequence))
        many = "X: y\r\n" * 200
        save = f"POST {path}/save HTTP/1.1\r\nHost: {host}\r\nContent-Length: {len(pairs)}\r\n\r\n{pairs}"
        page = f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n"
        for request in (page, f"GET / HTTP/1.1\r\n{many}\r\n", "\0\r\n", save):
            with socket.create_connection(("127.0.0.1", int(host.split(":")[1]))) as connection:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                connection.sendall(request.encode())  # and reset the connection instead of reading the answer
    assert picking.out.exists()
    assert "Traceback" not in capfd.readouterr().err
