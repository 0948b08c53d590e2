"""External trackers end to end on the tiny sequence: good programs, and programs that do everything wrong."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.bench.process_trees import is_alive, wait_until
from uavbench.bench.external.program import External, track_external
from uavbench.bench.external.rows import FAULTS, TrackerFault
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.third_party.opencv_rapid import OpencvRapid
from uavbench.bench.trial.check import TRIAL, check
from uavbench.scenes.dataset.body import Feed, body_of
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.sensor import Table, write_table

PATIENT_S = 60.0
"""For programs that answer, on a machine however busy."""
HUNG_S = 4.0
"""For programs that stop answering: what they do before takes some ms."""
HOLD = """
import sys, tomllib, time, os
m = tomllib.load(open("init.toml", "rb"))["cam_from_model"]
def pose():
    w = (1 + m[0][0] + m[1][1] + m[2][2]) ** 0.5 / 2
    q = [w, (m[2][1] - m[1][2]) / 4 / w, (m[0][2] - m[2][0]) / 4 / w, (m[1][0] - m[0][1]) / 4 / w]
    return ",".join(repr(v) for v in [m[0][3], m[1][3], m[2][3], *q])
def say(line):
    print(line, flush=True)
"""
STREAM = """
say("ready")
count = -1
for line in sys.stdin.buffer:
    kind, *rest = line.decode().strip().split(",")
    if kind != "frame": continue
    stamp, w, h, c = map(int, rest)
    pixels = sys.stdin.buffer.read(w * h * c)
    count += 1
    {each}
    say(f"{{stamp}},ok,{{pose()}}")
"""
FOLDER = """
rows = [line.split(",")[0] for line in open("frames.csv").read().splitlines()[1:]]
lines = [f"{{s}},ok,{{pose()}}" for s in rows]
{change}
open("estimates.csv", "w").write("stamp_ns,status,px_m,py_m,pz_m,qw,qx,qy,qz\\n" + "\\n".join(lines) + "\\n")
{after}
"""


@pytest.fixture(scope="module")
def sequence():
    return Sequence.load(TRIAL)


@pytest.fixture
def program(tmp_path):
    def make(text, **options):
        path = tmp_path / "program.py"
        path.write_text(HOLD + text)
        return External(
            command=(sys.executable, str(path)), **{"timeout_s": PATIENT_S, "start_timeout_s": PATIENT_S, **options}
        )

    return make


@pytest.fixture
def run(sequence, tmp_path):
    def track(tracker, rate_hz=15.0):
        results = track_external(tracker, sequence, rate_hz=rate_hz, seed=3, kept_folder=tmp_path / "kept" / "job")
        names = [e.split("]")[0].strip("[") for e in results.record["errors"]]
        assert set(names) <= set(FAULTS)
        assert (tmp_path / "kept" / "job" / "faults.txt").exists() == bool(names)
        return results, names

    return track


def stream_program(each="pass"):
    return STREAM.format(each=each)


def folder_program(change="pass", after="pass"):
    return FOLDER.format(change=change, after=after)


@pytest.mark.parametrize("mode", ["stream", "folder"])
def test_a_program_that_holds_gives_what_hold_gives(program, run, sequence, mode):
    results, faults = run(program(stream_program() if mode == "stream" else folder_program(), mode=mode))
    assert faults == []
    expected = track_sequence(Hold(), sequence, rate_hz=15.0, seed=3)
    np.testing.assert_allclose(
        [p.matrix for p in results.cam_from_world], [p.matrix for p in expected.cam_from_world], atol=1e-12
    )
    assert results.record["tracker"]["kind"] == "external"
    timed = [row.stage_ms.get("total", 0) > 0 for row in results.rows]
    assert all(timed) if mode == "stream" else not any(timed)


@pytest.mark.parametrize("mode", ["stream", "folder"])
def test_every_third_frame_at_a_third_of_the_rate(program, run, sequence, mode):
    results, faults = run(program(stream_program() if mode == "stream" else folder_program(), mode=mode), rate_hz=5.0)
    assert faults == []
    assert results.frames.tolist() == list(range(0, len(sequence), 3))


def test_results_survive_their_folder(program, run, tmp_path):
    results, _ = run(program(stream_program()))
    results.save(tmp_path / "results")
    assert type(results).load(tmp_path / "results").ok.all()


@pytest.mark.parametrize(
    ("each", "fault", "ok"),
    [
        ("if count == 4: sys.exit(3)", "crashed", 4),
        ("if count == 4: os.abort()", "crashed", 4),
        ("if count == 4: time.sleep(60)", "hung", 4),
        ("if count == 4: say('nonsense')", "malformed", 4),
        ("if count == 4: stamp += 1", "unknown-stamp", 4),
        ("if count == 4: say(f'{stamp},lost')", "duplicate", 4),
        ("if count == 4: say('tracking...'); time.sleep(0.2)", "malformed", 4),
        ("if count == 9: say(f'{stamp},ok,{pose()}'); say('done'); break", "unasked", 10),
        ("if count == 4: sys.stdout.buffer.write(b'x' * 100000); sys.stdout.flush()", "malformed", 4),
        ("if count == 4: sys.stdout.buffer.write(b'\\xff\\xfe\\n'); sys.stdout.flush()", "malformed", 4),
        ("if count == 4: say(f'{stamp},ok,nan,0,0,1,0,0,0'); continue", "not-finite", 9),
        ("if count == 4: say(f'{stamp},ok,0,0,0,1,1,0,0'); continue", "bad-rotation", 9),
        ("if count == 9: say(f'{stamp},lost')", "duplicate", 9),
    ],
)
def test_faults_in_a_stream(program, run, each, fault, ok):
    results, faults = run(program(stream_program(each), timeout_s=HUNG_S if fault == "hung" else PATIENT_S))
    assert faults == [fault]
    assert int(results.ok.sum()) == ok


@pytest.mark.parametrize("pause_s", [0.0, 0.2])
def test_a_second_answer_after_one_that_is_not_finite_is_a_duplicate(program, run, pause_s):
    """It was taken for an answer of an unknown stamp, and in flight it cost all frames that followed."""
    each = (
        f"if count == 4: say(f'{{stamp}},ok,nan,0,0,1,0,0,0'); say(f'{{stamp}},lost'); time.sleep({pause_s}); continue"
    )
    assert run(program(stream_program(each)))[1] == ["not-finite", "duplicate"]


def test_faults_at_the_start_of_a_stream(program, run):
    assert run(program("say('hello')\ntime.sleep(60)"))[1] == ["not-ready"]
    assert run(program("time.sleep(60)", start_timeout_s=0.5))[1] == ["hung"]
    assert run(program("raise SystemExit('no model')"))[1] == ["crashed"]
    results, faults = run(program("say('ready')\ntime.sleep(60)", timeout_s=0.5))  # never reads
    assert faults == ["hung"]
    assert not results.ok.any()


@pytest.mark.parametrize(
    ("change", "after", "fault", "ok"),
    [
        ("lines.pop(3)", "pass", "missing", 9),
        ("lines.insert(3, lines[3])", "pass", "duplicate", 10),
        ("lines[2], lines[3] = lines[3], lines[2]", "pass", "out-of-order", 10),
        ("lines[3] = rows[3] + ',ok,nan,0,0,1,0,0,0'", "pass", "not-finite", 9),
        ("lines[3] = rows[3] + ',ok,1'", "pass", "malformed", 9),
        ("lines.append('7' + lines[3][len(rows[3]):])", "pass", "unknown-stamp", 10),
        ("sys.exit(4)", "pass", "crashed", 0),
        ("sys.exit(0)", "pass", "no-output", 0),
        ("pass", "sys.exit(4)", "crashed", 10),
        ("pass", "time.sleep(60)", "hung", 10),
    ],
)
def test_faults_in_a_folder(program, run, change, after, fault, ok):
    tracker = program(folder_program(change, after), mode="folder", timeout_s=HUNG_S if fault == "hung" else PATIENT_S)
    results, faults = run(tracker)
    assert faults == [fault]
    assert int(results.ok.sum()) == ok


def test_a_program_that_is_not_there_is_an_error_at_once(run):
    with pytest.raises(TrackerFault, match="cannot-start"):
        run(External(command=("no-such-tracker",)))


def test_a_crash_is_told_with_the_last_words(program, run):
    results, _ = run(program(stream_program("if count == 2: raise RuntimeError('out of edges')")))
    assert "frame 2" in results.record["errors"][0]
    assert "RuntimeError: out of edges" in results.record["errors"][0]


def test_memory_beyond_the_limit_is_refused(program, run):
    results, faults = run(program(stream_program("if count == 1: x = bytearray(1 << 30)"), memory_mb=512))
    assert faults == ["crashed"]
    assert "MemoryError" in results.record["errors"][0]
    assert "512 MB" in results.record["errors"][0]


def test_memory_of_all_processes_together_is_limited(program, run):
    many = """
        if count == 1:
            import subprocess
            hog = "x = bytearray(80 << 20); import time; time.sleep(600)"
            for _ in range(6):
                subprocess.Popen([sys.executable, "-I", "-S", "-c", hog], start_new_session=True)
            time.sleep(600)
"""
    text = STREAM.replace("    {each}\n", many.replace("\n        ", "\n    ")).replace("{{", "{").replace("}}", "}")
    results, faults = run(program(text, memory_mb=300, timeout_s=60.0))
    assert faults == ["out-of-memory"]
    assert "300" in results.record["errors"][0]
    assert int(results.ok.sum()) == 1


@pytest.mark.parametrize("mode", ["stream", "folder"])
def test_what_a_program_says_commands_no_terminal(program, run, tmp_path, mode):
    hostile = "\\x1b[31m\\x1b]0;title\\x07\\x9b2J\\r\\u202e"
    each = f"if count == 2: print('{hostile}', file=sys.stderr, flush=True); say('{hostile}'); sys.exit(3)"
    text = stream_program(each) if mode == "stream" else f"print('{hostile}'); sys.exit('{hostile}')"
    results, _ = run(program(text, mode=mode))
    kept = [path.read_text() for path in (tmp_path / "kept" / "job").glob("*.txt")]
    for said in (*results.record["errors"], *kept):
        assert not {c for c in said if not c.isprintable()} - {"\n", "\t"}, ascii(said)
    assert any("\\x1b[31m" in said for said in kept)


def test_the_truth_is_neither_in_the_folder_nor_in_the_environment(program, run, monkeypatch, tmp_path, sequence):
    monkeypatch.setenv("SECRET_TOKEN", "hunter2")
    text = """
import json
seen = {"files": sorted(os.path.join(d, f) for d, _, fs in os.walk(".") for f in fs),
        "text": [open(os.path.join(d, f), errors="replace").read() for d, _, fs in os.walk(".") for f in fs
                 if not f.endswith(".png")],
        "environment": dict(os.environ), "cwd": os.getcwd()}
open(%r, "w").write(json.dumps(seen))
"""
    for mode in ("stream", "folder"):
        rest = stream_program() if mode == "stream" else folder_program()
        run(program(text % str(tmp_path / mode) + rest, mode=mode))
        seen = json.loads((tmp_path / mode).read_text())
        names = {Path(name).name for name in seen["files"]}
        assert names >= {"job.toml", "camera.toml", "model.obj", "edges.csv", "init.toml"}
        assert not names & {"groundtruth.csv", "sequence.json", "manifest.json"}
        assert "SECRET_TOKEN" not in seen["environment"]
        assert str(sequence.folder) not in json.dumps(seen)
        position = repr(float(sequence.ground_truth.positions_m[5, 0]))
        assert not any(position in text for text in seen["text"])
        assert not Path(seen["cwd"]).exists()


def test_no_shell_and_nobody_left_behind(run, tmp_path, program):
    pid_file = tmp_path / "pid"
    child = f"""
import subprocess
p = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open({str(pid_file)!r}, "w").write(str(p.pid))
"""
    assert run(program(child + stream_program("if count == 1: time.sleep(60)"), timeout_s=HUNG_S))[1] == ["hung"]
    pid = int(pid_file.read_text())
    assert wait_until(lambda: not is_alive(pid))
    with pytest.raises(TrackerFault, match="cannot-start"):
        run(External(command=("true; touch " + str(tmp_path / "shell"),)))
    assert not (tmp_path / "shell").exists()


def test_a_killed_harness_takes_the_program_with_it(tmp_path, program):
    pid_file = tmp_path / "pid"
    tracker = program(f"open({str(pid_file)!r}, 'w').write(str(os.getpid()))\ntime.sleep(600)\n", mode="folder")
    code = f"""
from pathlib import Path
from tests.bench.process_trees import is_alive, wait_until
from uavbench.bench.external.program import External, track_external
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence
tracker = External(command={tracker.command!r}, mode="folder", timeout_s=600)
track_external(tracker, Sequence.load(TRIAL), rate_hz=15.0, seed=0, kept_folder=Path({str(tmp_path / "k")!r}))
"""
    harness = subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parents[2])
    try:
        assert wait_until(lambda: pid_file.exists() and pid_file.read_text())
        pid = int(pid_file.read_text())
        assert is_alive(pid)
    finally:
        harness.send_signal(signal.SIGKILL)
        harness.wait()
    assert wait_until(lambda: not is_alive(pid))


def test_imu_samples_come_before_their_frame_and_never_early(program, tmp_path, sequence):
    folder = tmp_path / "with-imu"
    shutil.copytree(TRIAL, folder)
    stamps = sequence.stamps_ns
    lines = [f"{t},0,0,0,0,0,9.81" for t in range(int(stamps[0]), int(stamps[-1]) + 20_000_000, 5_000_000)]
    (folder / "imu.csv").write_text(
        "stamp_ns,wx_rad_s,wy_rad_s,wz_rad_s,ax_m_s2,ay_m_s2,az_m_s2\n" + "\n".join(lines) + "\n"
    )
    log = tmp_path / "log"
    text = f"""
say("ready")
log = open({str(log)!r}, "w")
while line := sys.stdin.buffer.readline():
    kind, *rest = line.decode().strip().split(",")
    log.write(kind + " " + rest[0] + "\\n")
    if kind == "imu": continue
    stamp, w, h, c = map(int, rest)
    sys.stdin.buffer.read(w * h * c)
    log.flush()
    say(f"{{stamp}},lost")
"""
    linked = replace(Sequence.load(TRIAL), folder=folder)
    results = track_external(program(text), linked, rate_hz=15.0, seed=0, kept_folder=tmp_path / "kept")
    assert results.record["errors"] == []
    told = [line.split() for line in log.read_text().splitlines()]
    order = [int(stamp) for _, stamp in told]
    assert order == sorted(order)
    assert sum(kind == "imu" for kind, _ in told) == sum(int(line.split(",")[0]) <= stamps[-1] for line in lines)


def test_readings_whose_columns_have_other_names_are_told(program, tmp_path):
    """Else a tracker would get the stamps of an IMU alone."""
    folder = tmp_path / "with-imu"
    shutil.copytree(TRIAL, folder)
    (folder / "imu.csv").write_text("stamp_ns,wx,wy,wz,ax,ay,az\n0,0,0,0,0,0,9.81\n")
    linked = replace(Sequence.load(TRIAL), folder=folder)
    with pytest.raises(UserError, match=r"imu\.csv: none of its columns is one of imu readings \(wx_rad_s, "):
        track_external(program(stream_program()), linked, rate_hz=15.0, seed=0, kept_folder=tmp_path / "kept")


@pytest.mark.parametrize("name", ["imu0", "imu_2", "IMU", "imu-bmi088 left"])
def test_readings_whose_file_has_another_name_are_told(tmp_path, name):
    """Else a tracker would go without them, and nobody would know."""
    shutil.copytree(TRIAL, tmp_path / "with-imu")
    (tmp_path / "with-imu" / "notes.csv").write_text("anything\n")
    (tmp_path / "with-imu" / f"{name}.csv").write_text("no header\n")
    with pytest.raises(UserError, match=rf"{name}\.csv: looks like readings of the sensor imu"):
        body_of(replace(Sequence.load(TRIAL), folder=tmp_path / "with-imu"))


def test_a_truth_is_read_only_where_the_sequence_lists_it_as_a_sensor(tmp_path):
    """As of a user's class `wheel_truth`; else it is the ground truth of readings."""
    shutil.copytree(TRIAL, tmp_path / "own")
    info = json.loads((tmp_path / "own" / "sequence.json").read_text())
    for name in ("wheel_truth", "wheel", "imu_truth"):
        write_table(Table(("a_m",), np.zeros(0, np.int64), np.zeros((0, 1))), tmp_path / "own" / f"{name}.csv")
    listed = {f"{name}.csv": {"kind": name, "measured": ["a_m"]} for name in ("wheel_truth", "wheel")}
    (tmp_path / "own" / "sequence.json").write_text(json.dumps(info | {"sensors": listed}))
    feed = Feed(Sequence.load(tmp_path / "own"))
    assert set(feed.body.sensors) == {"wheel_truth", "wheel"}
    assert not len(feed.upto(10**12)["wheel"]), "a sensor that found nothing"


def test_it_starts_like_any_tracker_frame_by_frame(program, sequence):
    tracker = program(stream_program())
    first = sequence.true_cam_from_world(0)
    run = tracker.start(sequence.structure, sequence.camera, first, stream(0, "test"))
    result = run.track(sequence.image(0), int(sequence.stamps_ns[0]))
    np.testing.assert_allclose(result.cam_from_world.matrix, first.matrix, atol=1e-12)
    pid = run.process.popen.pid
    del run
    assert wait_until(lambda: not is_alive(pid))


def test_a_change_of_the_program_makes_its_results_stale(program, tmp_path):
    tracker = program(stream_program())
    before = content_hash(tracker)
    assert content_hash(tracker) == before
    (tmp_path / "program.py").write_text("other")
    assert content_hash(tracker) != before


def told(tracker, tmp_path):
    return list(check(tracker, tmp_path / "kept"))


def test_check_of_a_good_tracker(program, tmp_path):
    lines = told(program(stream_program()), tmp_path)
    assert lines[-1].startswith("good")
    assert "a second run gave the same poses" in lines


def test_check_recognizes_the_usual_mistakes_of_convention(program, tmp_path):
    swapped = "p = pose().split(','); say(f'{stamp},ok,' + ','.join(p[:3] + p[4:] + p[3:4])); continue"
    assert any("w last" in line for line in told(program(stream_program(swapped)), tmp_path))
    mm = (
        "p = pose().split(','); say(f'{stamp},ok,' + ','.join([str(1000 * float(v)) for v in p[:3]] + p[3:])); continue"
    )
    assert any("millimetres" in line for line in told(program(stream_program(mm)), tmp_path))


def test_check_explains_a_fault_and_names_the_folder(program, tmp_path):
    lines = told(program(stream_program("if count == 2: sys.exit(1)")), tmp_path)
    assert any("[crashed]" in line for line in lines)
    assert any(str(tmp_path / "kept") in line for line in lines)
    assert lines[-1] == "faulty"


def test_check_takes_an_in_process_tracker_too(tmp_path):
    assert told(Hold(), tmp_path)[-1].startswith("good")


def test_the_trial_sequence_is_small_and_whole():
    assert sum(path.stat().st_size for path in TRIAL.rglob("*") if path.is_file()) < 300_000
    manifest = json.loads((TRIAL / "manifest.json").read_text())["sha256"]
    assert {p.relative_to(TRIAL).as_posix() for p in TRIAL.rglob("*") if p.is_file()} == {*manifest, "manifest.json"}


def test_environment_of_a_program_is_a_list_of_few(program, run, tmp_path, monkeypatch):
    text = f"open({str(tmp_path / 'env')!r}, 'w').write(repr(dict(os.environ)))"
    monkeypatch.setenv("LC_ALL", "de_DE.UTF-8")
    monkeypatch.setenv("LANG", "de_DE.UTF-8")
    run(program(text + stream_program()))
    from uavbench.bench.external.process import PASSED_ON

    seen = eval((tmp_path / "env").read_text())
    assert set(seen) <= {*PASSED_ON, "TMPDIR", "PYTHONUNBUFFERED", "LC_ALL", "LC_CTYPE"}
    assert seen["LC_ALL"] == "C.UTF-8", "numbers with a point, whatever the user's locale"
    assert os.environ["PATH"]


def test_the_number_of_threads_that_is_passed_on_is_in_the_key_of_a_program(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    before = content_hash(External(command=("true",))), content_hash(OpencvRapid())
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    after = content_hash(External(command=("true",))), content_hash(OpencvRapid())
    assert before[0] != after[0] and before[1] != after[1]
