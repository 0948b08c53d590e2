"""Nothing of a challenge's package tells the ground truth or the seed: it is searched, and guessed at, here."""

import csv
import dataclasses
import getpass
import hashlib
import json
import shutil
import socket
import struct
import tomllib
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

import uavbench as ub
from tests.bench.conftest import CONTEST, packed
from tests.bench.small_suites import recorded_suite
from tests.bench.test_what_trackers_see import COMMON
from uavbench.bench.challenge.guesses import refuse_guessed
from uavbench.bench.challenge.organizer import SECRET, Challenge
from uavbench.bench.challenge.package import NO_TIME_S, bare_png
from uavbench.bench.challenge.secret import Secret, read_or_make
from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_suite
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.image_files import decoded
from uavbench.scenes.scene import obstacles_of
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import tree
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.simulation.flight import fly
from uavbench.trajectories.trajectory import Trajectory

LEAST_FOUND = 6
"""Characters of what is looked for in all bytes: fewer, as of the host `vm`, stand in those of an image by chance."""


def package(folder):
    return {name: (folder / "participants" / name).read_bytes() for name in tree(folder / "participants")}


def test_the_package_holds_what_trackers_are_given_and_no_more(challenge):
    names = set(package(challenge))
    sequences = {name.split("/")[0] for name in names if "/" in name}
    assert sequences == {"sequence-01", "sequence-02"}
    for sequence in sequences:
        inside = {name.removeprefix(f"{sequence}/") for name in names if name.startswith(sequence)}
        frames = {f"frames/{k:06d}.png" for k in range(7)}
        assert inside == (COMMON - {"job.toml"}) | {"frames.csv", "imu.csv", "gnss.csv"} | frames
    assert names - {n for n in names if "/" in n} == {"README.md", "package.json"}


def test_the_organizer_keeps_truth_secret_and_names(challenge):
    kept = challenge / "kept"
    assert (kept / SECRET).stat().st_mode & 0o777 == 0o600
    found = Challenge.load(kept)
    assert sorted(hidden.name for hidden in found.sequences.values()) == ["quarry-s770177017", "quarry-s770277027"]
    for hidden in found.sequences.values():
        assert len(Sequence.load(kept / "sequences" / hidden.name).ground_truth) == 7


def texts_to_hide(folder):
    """Names, seeds, paths, and every number of the ground truth, as text."""
    secret = tomllib.loads((folder / "kept" / SECRET).read_text())["secret"]
    yield from (
        "quarry",
        "770177017",
        "770277027",
        "title that tells",
        "seed",
        "content_hash",
        "contest",
        secret,
        secret.upper(),
    )
    yield from (str(folder), str(folder.parent), f"/{getpass.getuser()}/", f"@{socket.gethostname()}", str(Path.cwd()))
    key = Secret(bytes.fromhex(secret))
    for name in ("quarry-s770177017", "quarry-s770277027"):
        sequence = folder / "kept" / "sequences" / name
        info = json.loads((sequence / "sequence.json").read_text())
        assert info["seed"] == key.seed(name)
        yield from (str(info["seed"]), f"{info['seed']:x}", info["content_hash"])
        yield from (str(value) for value in np.ravel(list(info["deviation"].values())) if len(str(value)) > 6)
        yield from json.loads((sequence / "manifest.json").read_text())["sha256"].values()


def numbers_to_hide(folder):
    for name in ("quarry-s770177017", "quarry-s770277027"):
        for table in ("groundtruth.csv", "flight.csv", "imu.csv"):
            with (folder / "kept" / "sequences" / name / table).open() as handle:
                for row in csv.DictReader(handle):
                    yield from (v for k, v in row.items() if (table != "imu.csv" or "bias" in k) and len(v) > 8)
        sequence = Sequence.load(folder / "kept" / "sequences" / name)
        for frame in range(len(sequence)):
            pose = sequence.true_cam_from_world(frame)
            yield from map(repr, [*pose.matrix.ravel().tolist(), *pose.inverse().matrix.ravel().tolist()])


def test_no_byte_of_the_package_tells_truth_seed_names_or_paths(challenge):
    files = package(challenge)
    text = b"\0".join(files.values())
    written = b"\0".join(data for name, data in files.items() if not name.endswith(".png"))
    readme = files["README.md"]
    given = {hashlib.sha256(data).hexdigest() for data in files.values()}  # digests of what is there tell nothing else
    for hidden in set(texts_to_hide(challenge)) - given:
        data = text if len(hidden) >= LEAST_FOUND else written
        data = data.replace(readme, b"") if hidden == "seed" else data
        assert hidden.encode() not in data, hidden
        assert not [name for name in files if hidden in name], hidden
    said = set(text.replace(b",", b" ").replace(b"[", b" ").replace(b"]", b" ").replace(b"\0", b" ").split())
    true = {v for v in numbers_to_hide(challenge) if "." in v and len(v) > 8 and abs(float(v)) not in (0.0, 1.0)}
    mounts = {
        repr(v) for v in Sequence.load(challenge / "kept/sequences/quarry-s770177017").cam_from_body.matrix.ravel()
    }
    assert len(true) > 1000
    assert not said & {value.encode() for value in true - mounts}
    for value in map(float, list(true - mounts)[::7]):
        for form in ("<d", ">d"):
            assert struct.pack(form, value) not in text


def test_no_byte_tells_the_seed_in_binary(challenge):
    text = b"".join(package(challenge).values())
    key = Secret(bytes.fromhex(tomllib.loads((challenge / "kept" / SECRET).read_text())["secret"]))
    for seed in (key.seed("quarry-s770177017"), key.seed("quarry-s770277027"), int.from_bytes(key.key, "big")):
        for order in ("big", "little"):
            data = seed.to_bytes(32, order)
            assert not [k for k in range(0, 32, 8) if data[k : k + 8] in text]


def test_images_hold_pixels_alone_and_files_no_times(challenge):
    for name, data in package(challenge).items():
        assert (challenge / "participants" / name).stat().st_mtime == NO_TIME_S
        if not name.endswith(".png"):
            continue
        chunks, at = set(), 8
        while at < len(data):
            length, kind = struct.unpack(">I4s", data[at : at + 8])
            chunks.add(kind)
            at += 12 + length
        assert at == len(data)
        assert chunks == {b"IHDR", b"IDAT", b"IEND"}
    folders = [path for path in (challenge / "participants").rglob("*") if path.is_dir()]
    assert {path.stat().st_mtime for path in [challenge / "participants", *folders]} == {NO_TIME_S}


def test_text_in_an_image_does_not_pass(tmp_path):
    done, data = cv2.imencode(".png", np.arange(300, dtype=np.uint8).reshape(10, 10, 3))
    said = b"tEXtComment\0px_m=1.25"
    chunk = struct.pack(">I", len(said) - 4) + said + struct.pack(">I", zlib.crc32(said))
    (tmp_path / "marked.png").write_bytes(data.tobytes()[:33] + chunk + data.tobytes()[33:])
    bare = bare_png(tmp_path / "marked.png")
    assert done and b"px_m" not in bare
    np.testing.assert_array_equal(decoded(tmp_path, bare), decoded(tmp_path, data.tobytes()))


def test_images_are_those_of_the_truth_and_of_no_public_seed(challenge):
    table = tomllib.loads(CONTEST)["sequences"]
    guessed = ub.render({"sequences": table, "seeds": [0, 770177017]}, out=challenge / "guessed")
    images = {frame.image.tobytes() for sequence in guessed for frame in sequence}
    files = {path.read_bytes() for path in (challenge / "guessed").rglob("*.png")}
    for alias, hidden in Challenge.load(challenge / "kept").sequences.items():
        truth = Sequence.load(challenge / "kept" / "sequences" / hidden.name)
        for number, frame in enumerate(truth):
            path = challenge / "participants" / alias / "frames" / f"{number:06d}.png"
            shown = cv2.imread(str(path), cv2.IMREAD_COLOR)
            np.testing.assert_array_equal(shown, frame.image)
            assert shown.tobytes() not in images
            assert path.read_bytes() not in files
        for other in guessed:
            assert np.abs(other.ground_truth.positions_m[-1] - truth.ground_truth.positions_m[-1]).max() > 1e-3


def test_a_place_where_no_package_can_be_made_is_told_before_anything_is_rendered(tmp_path):
    (tmp_path / "contest.toml").write_text(CONTEST)
    (tmp_path / "notes").write_text("mine")
    done = packed(tmp_path / "contest.toml", tmp_path / "notes" / "package", "--truth", tmp_path / "kept")
    assert done.exit_code == 2 and "notes is not a folder" in done.output
    assert not (tmp_path / "kept").exists()


def test_the_truth_of_a_package_is_not_replaced_by_another_version(challenge, tmp_path, monkeypatch):
    kept, suite = shutil.copytree(challenge / "kept", tmp_path / "kept"), challenge / "contest.toml"
    before = {name: (kept / "sequences" / name).read_bytes() for name in tree(kept / "sequences")}
    with monkeypatch.context() as patched:
        patched.setattr("uavbench.bench.runner.jobs.code_hash", lambda *packages: "of another version")
        done = packed(suite, tmp_path / "again", "--truth", kept, "--private-suite")
    assert done.exit_code == 2 and "rendered by another version" in done.output and f"{kept}: " in done.output
    assert {name: (kept / "sequences" / name).read_bytes() for name in before} == before
    record = next(iter(sorted((kept / "made" / "sequences").glob("*/sequence.json"))))
    text = record.read_text()
    seen = {"files": {"/read/by/a/plug-in": "of another content"}, "lists": [], "own": []}
    record.write_text(json.dumps({**json.loads(text), "inputs": seen}))
    done = packed(suite, tmp_path / "again", "--truth", kept, "--private-suite")
    assert done.exit_code == 2 and "a file that one reads" in done.output
    record.write_text(text)
    lost = next(iter(sorted((kept / "sequences").glob("*/frames/000000.png"))))
    lost.unlink()
    assert packed(suite, tmp_path / "again", "--truth", kept, "--private-suite").exit_code == 0
    assert lost.is_file(), "what is damaged is made again, the same"


def test_the_truth_of_another_version_is_another_challenge_with_the_same_secret(challenge, tmp_path, monkeypatch):
    monkeypatch.setattr("uavbench.bench.runner.jobs.code_hash", lambda *packages: "of another version")
    more = ("--truth", tmp_path / "kept", "--secret", challenge / "kept" / SECRET, "--private-suite")
    done = packed(challenge / "contest.toml", tmp_path / "participants", *more)
    assert done.exit_code == 0, done.output
    before, after = (Challenge.load(folder) for folder in (challenge / "kept", tmp_path / "kept"))
    assert before.sequences == after.sequences
    assert before.challenge != after.challenge
    assert json.loads((tmp_path / "participants/package.json").read_text())["challenge"] == after.challenge


def test_packing_again_renders_nothing_and_gives_the_same_bytes(challenge):
    before = package(challenge)
    done = packed(challenge / "contest.toml", challenge / "again", "--truth", challenge / "kept", "--private-suite")
    assert done.exit_code == 0 and "0 jobs done, 2 were fresh" in done.output
    assert {name: (challenge / "again" / name).read_bytes() for name in tree(challenge / "again")} == before


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--truth", "participants/kept"], "must not contain each other"),
        (["--truth", "kept", "--secret", "new/secret.toml"], "participants get"),
        (["--truth", "kept", "--secret", "weak.toml"], "can be guessed"),
        (["--truth", "kept", "--secret", "short.toml"], "64 hexadecimal digits"),
        (["--truth", "kept", "--secret", "other.toml"], "belongs to another challenge"),
    ],
)
def test_what_would_tell_the_truth_is_refused(challenge, monkeypatch, more, message):
    monkeypatch.chdir(challenge)
    (challenge / "weak.toml").write_text(f'secret = "{770177017:064x}"\n')
    (challenge / "short.toml").write_text("secret = 770177017\n")
    read_or_make(challenge / "other.toml")
    out = "participants" if "participants" in more[1] else "new"
    done = packed("contest.toml", out, "--private-suite", *more)
    assert done.exit_code == 2 and message in done.output, done.output
    assert not (challenge / "new").exists()


def test_pack_makes_packages_without_truth_alone(challenge):
    done = CliRunner().invoke(main, ["pack", "tiny", "--out", str(challenge / "no")])
    assert done.exit_code == 2 and "confirm with --without-truth" in done.output


def test_a_package_has_the_main_camera_alone_and_pack_names_the_others(tmp_path):
    """They had been left out without a word."""
    more = """
    cameras = [
        { name = "left", camera = { width = 64, height = 48 }, mount = { yaw_deg = 9.0 }, offset_s = 0.01 },
        { name = "below", camera = { width = 64, height = 48 }, mount = { pitch_deg = -60.0 } },
    ]
    [trackers]"""
    text = CONTEST.replace("[trackers]", more).replace("seeds = [770177017, 770277027]", "seeds = [770177017]")
    (tmp_path / "rig.toml").write_text(text)
    done = packed(tmp_path / "rig.toml", tmp_path / "participants", "--truth", tmp_path / "kept", "--private-suite")
    assert done.exit_code == 0, done.output
    assert "not in the package, as trackers are given the main camera alone: images of below, left" in done.output
    files = package(tmp_path)
    tables = {name for name in files if name.endswith(".csv")}
    assert tables == {f"sequence-01/{name}.csv" for name in ("edges", "frames", "gnss", "imu")}
    kept = Sequence.load(tmp_path / "kept/sequences/quarry-s770177017")
    for name in ("left", "below"):
        assert len(kept.cameras[name]) > 1
        assert not [file for file, data in files.items() if name in file or f'"{name}"'.encode() in data]
    assert files["sequence-01/frames.csv"].decode().split()[1:] == [
        f"{stamp},frames/{k:06d}.png" for k, stamp in enumerate(kept.stamps_ns.tolist())
    ]


def flown(path, tmp_path):
    """Spec of a sequence on a path, and its true poses at 10 Hz under a secret seed."""
    text = CONTEST.replace('{ kind = "hand-pilot", duration_s = 0.4 }', path).replace('"dryden"', '"still"')
    (tmp_path / "suite.toml").write_text(text)
    spec = dataclasses.replace(load_suite(tmp_path / "suite.toml").sequences[0], seed=2**255 + 7)
    flight = fly(spec.flight, spec.mount, obstacles_of(spec), spec.seed)
    rows = slice(None, None, 50)  # of 2 ms
    return spec, Trajectory(flight.stamps_ns[rows], flight.positions_m[rows], flight.quaternions_wxyz[rows])


def test_a_flight_that_the_file_tells_is_refused(tmp_path):
    with pytest.raises(UserError, match="the path depends too little on the seed"):
        refuse_guessed(*flown('{ kind = "orbit", turns = 0.15, duration_s = 6.0 }', tmp_path))
    refuse_guessed(*flown('{ kind = "hand-pilot", duration_s = 8.0 }', tmp_path))


def test_a_secret_is_made_once_and_is_long(tmp_path):
    first, again = read_or_make(tmp_path / "secret.toml"), read_or_make(tmp_path / "secret.toml")
    assert first == again != read_or_make(tmp_path / "other.toml")
    assert len(first.key) == 32 and first.seed("a").bit_length() == 256 and first.seed("a") != first.seed("b")
    assert first.key.hex() not in repr(first)
    with pytest.raises(UserError, match="expected secret"):
        (tmp_path / "empty.toml").write_text("")
        read_or_make(tmp_path / "empty.toml")


def test_streams_of_a_secret_seed_are_no_seed_sequences(tmp_path):
    """SeedSequence can be inverted, an HMAC cannot; seeds that a suite may name keep their numbers."""
    seed = read_or_make(tmp_path / "secret.toml").seed("a")
    assert stream(seed, "path").integers(2**62) == stream(seed, "path").integers(2**62)
    assert stream(seed, "path").integers(2**62) != stream(seed, "wind").integers(2**62)
    assert stream(seed, "path").integers(2**62) != stream(seed % 2**63, "path").integers(2**62)
    assert stream(2**63 - 1, "path").bit_generator.seed_seq.spawn_key != ()
    assert stream(seed, "path").bit_generator.seed_seq.spawn_key == ()


def test_recordings_are_refused_whether_their_poses_are_known_or_not(tmp_path):
    done = packed(recorded_suite(tmp_path, 'hold = { kind = "hold" }\n'), tmp_path / "out")
    assert done.exit_code != 0
    assert "has recorded images; challenges are of rendered ones" in " ".join(done.output.split())
    assert not (tmp_path / "out").exists()
