"""A tracker that looks for the ground truth in every place it knows of: found when it is not isolated, else not."""

import json
import os
import re
import shutil
import socket
import sys
from dataclasses import replace

import pytest

from tests.bench.test_external import FOLDER, HOLD, STREAM
from uavbench.bench.external import isolation
from uavbench.bench.external.program import External, isolated_trackers, track_external
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.baselines.hold import Hold
from uavbench.trajectories.errors import UserError

THIEF = """
import glob, json, os, socket, tempfile
found = []
def look(path):
    try:
        if os.path.isdir(path):
            for name in os.listdir(path): look_at(os.path.join(path, name))
        else: look_at(path)
    except OSError: pass
def look_at(path):
    try:
        if os.path.isfile(path) and SECRET in open(path, "rb").read(1 << 22): found.append(path)
    except OSError: pass
pids = [p for p in os.listdir("/proc") if p.isdigit()]
near = {str(os.getpid()), str(os.getppid()), "1", "self"}
for pid in pids:
    try:
        if b"uavbench" in open(f"/proc/{pid}/cmdline", "rb").read(): near.add(pid)
    except OSError: pass
for pid in list(near) + PIDS:
    for link in glob.glob(f"/proc/{pid}/fd/*"): look(link)
    look(f"/proc/{pid}/cwd")
    for truth in TRUTH: look_at(f"/proc/{pid}/root{truth}"); look_at(f"/proc/{pid}/cwd{truth}")
    try:
        memory = open(f"/proc/{pid}/mem", "rb", 0)
        for line in open(f"/proc/{pid}/maps"):
            first, last = (int(v, 16) for v in line.split()[0].split("-"))
            if " rw" not in line or last - first > 1 << 26: continue
            memory.seek(first)
            if SECRET in memory.read(last - first) and pid not in ("self", str(os.getpid())): found.append(f"mem {pid}")
    except (OSError, ValueError): pass
for truth in TRUTH: look_at(truth)
for name in ("/tmp", "/dev/shm", "/run", "/var", "/home", "/root", "/mnt", ".."): look(name)
if any(SECRET.decode() in value for value in os.environ.values()): found.append("environment")
for family, address in ((socket.AF_INET, ("127.0.0.1", PORT)), (socket.AF_UNIX, "\\0" + NAME)):
    try:
        with socket.socket(family) as s:
            s.settimeout(2)
            s.connect(address)
            found.append(f"network {address}")
    except OSError: pass
written = []
for path in WRITE:
    try:
        open(path, "a").write("x"); written.append(path)
    except OSError: pass
open("loot.json", "w").write(json.dumps({"found": found, "written": written, "pids": pids}))
"""
WAYS = {"bwrap": isolation._bubblewrap, "unshare": isolation._unshare}


@pytest.fixture
def stolen(tmp_path, monkeypatch):
    """What a thief brought home, isolated in some way or not at all."""
    dataset = tmp_path / "dataset"
    shutil.copytree(TRIAL, dataset)
    secret = (dataset / "groundtruth.csv").read_bytes().splitlines()[5][:60]
    held = (dataset / "groundtruth.csv").open("rb")  # as a harness may
    tcp, unix, name = socket.create_server(("127.0.0.1", 0)), socket.socket(socket.AF_UNIX), f"uavbench-{os.getpid()}"
    unix.bind(f"\0{name}")
    unix.listen()
    monkeypatch.chdir(dataset)
    monkeypatch.setenv("SECRET", secret.decode())

    def steal(mode, way, **options):
        mine = {"SECRET": secret, "PIDS": [str(os.getpid())], "TRUTH": [str(dataset / "groundtruth.csv")], "NAME": name}
        mine |= {"PORT": tcp.getsockname()[1], "WRITE": [str(dataset / "x"), "/proc/sys/kernel/x", str(tmp_path / "x")]}
        head = "".join(f"{key} = {value!r}\n" for key, value in mine.items())
        rest = STREAM.format(each="pass") if mode == "stream" else FOLDER.format(change="pass", after="pass")
        (tmp_path / "thief.py").write_text(head + THIEF + HOLD + rest + "\nos._exit(7)\n")
        if way:
            monkeypatch.setattr(isolation, "usable", lambda: WAYS[way])
        tracker = External(command=(sys.executable, str(tmp_path / "thief.py")), mode=mode, isolate=bool(way))
        kept = tmp_path / "kept" / f"{mode}{way}"
        results = track_external(
            replace(tracker, **options), Sequence.load(dataset), rate_hz=15.0, seed=0, kept_folder=kept
        )
        assert [error.split("]")[0] for error in results.record["errors"]] == ["[crashed"], results.record["errors"]
        assert results.ok.all()  # it could do its work
        loot = json.loads((kept / "loot.json").read_text())
        # what it writes in its own /tmp is written nowhere else
        loot["written"] = [path for path in loot["written"] if not path.startswith("/tmp") or os.path.lexists(path)]
        return loot

    yield steal
    held.close()
    tcp.close()
    unix.close()


def works(way):
    try:
        isolation.usable.cache_clear()
        return shutil.which(way) is not None and isolation.usable() is not None
    except UserError:
        return False


@pytest.mark.parametrize("mode", ["stream", "folder"])
def test_a_thief_finds_the_truth_without_isolation(stolen, mode):
    loot = stolen(mode, None)
    assert any(path.endswith("groundtruth.csv") for path in loot["found"])
    for way in (r"/proc/\d+/fd/", r"/proc/\d+/cwd/", r"/proc/\d+/root/", r"mem \d+", "network \0uavbench-"):
        assert any(re.match(way, path) for path in loot["found"]), f"the attack by {way} is none"
    assert str(os.getpid()) in loot["pids"]
    assert any("groundtruth.csv" in path or "fd" in path for path in loot["found"])
    assert any("127.0.0.1" in path for path in loot["found"])
    assert loot["written"]


@pytest.mark.parametrize("mode", ["stream", "folder"])
@pytest.mark.parametrize("way", list(WAYS))
def test_an_isolated_thief_finds_and_changes_nothing(stolen, mode, way):
    if not works(way):
        pytest.skip(f"{way} makes no namespaces here")
    loot = stolen(mode, way)
    assert loot["found"] == []
    assert loot["written"] == []
    assert str(os.getpid()) not in loot["pids"]
    assert len(loot["pids"]) <= 3


def test_where_no_namespaces_can_be_made_it_is_refused_by_name(monkeypatch, tmp_path):
    isolation.usable.cache_clear()
    fake = tmp_path / "bin"
    fake.mkdir()
    (fake / "bwrap").write_text("#!/bin/sh\necho 'bwrap: No permissions to create new namespace' >&2\nexit 1\n")
    (fake / "bwrap").chmod(0o755)
    monkeypatch.setenv("PATH", f"{fake}:/nonexistent")
    with pytest.raises(
        UserError, match=r"No permissions to create new namespace; unshare is not installed.*bubblewrap"
    ):
        isolated_trackers({"mine": External(command=("true",))})
    isolation.usable.cache_clear()


class Mine:
    def start(self, structure, camera, cam_from_world, rng):
        raise NotImplementedError


def test_python_code_of_ones_own_cannot_be_isolated(monkeypatch):
    monkeypatch.setattr("uavbench.bench.external.program.usable", lambda: None)
    with pytest.raises(UserError, match=r"trackers\.mine is Python code"):
        isolated_trackers({"mine": Mine()})
    given = isolated_trackers({"hold": Hold(), "program": External(command=("true",))})
    assert given == {"hold": Hold(), "program": External(command=("true",), isolate=True)}


def test_an_isolated_program_sees_what_it_runs_and_not_what_it_names(tmp_path):
    """Its helper and its weights, but no ground truth: of this dataset or of another that a text in it names."""
    for name in ("one", "two"):
        shutil.copytree(TRIAL, tmp_path / name)
    program = tmp_path / "program"
    program.mkdir()
    (program / "weights").write_text("1")
    (program / "helper.py").write_text(f"TRUTH = {str(tmp_path / 'two' / 'groundtruth.csv')!r}\n")
    text = (
        f"import helper\nNAMES = ('notes', {str(tmp_path / 'one' / 'groundtruth.csv')!r}, '../two/groundtruth.csv')\n"
    )
    (program / "track.py").write_text(text)
    (program / "notes").write_text("mine")
    command = (sys.executable, str(program / "track.py"))
    tracker = External(command=command, input_files=(str(program / "weights"),), isolate=True)
    own = {path for path in tracker.seen_files if tmp_path in path.parents}
    assert own == {program / "track.py", program / "helper.py", program / "weights"}
    isolation.refuse_seen(command[0], tracker.seen_files, tmp_path / "one")
    assert program / "notes" in tracker.entering_files, "its change makes results stale all the same"


def test_a_dataset_that_would_be_seen_is_refused(tmp_path):
    inside = tmp_path / "sequence"
    shutil.copytree(TRIAL, inside)
    tracker = External(command=("true",), input_files=(str(inside / "groundtruth.csv"),), isolate=True)
    with pytest.raises(UserError, match="would be visible"):
        track_external(tracker, Sequence.load(inside), rate_hz=15.0, seed=0, kept_folder=tmp_path / "kept")
