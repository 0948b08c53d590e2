"""Commands tell of trackers that write their poses in another convention."""

from tests.bench.conftest import in_this_process
from tests.bench.small_suites import SMALL
from tests.bench.test_external import HOLD, STREAM
from uavbench.bench.runner.commands import ExecutionOptions, bring_up_to


def test_poses_of_another_convention_are_told_once_a_run(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("uavbench.bench.runner.commands.local_pool", in_this_process)
    path, out = tmp_path / "small.toml", tmp_path / "out"
    centre = "R = [row[:3] for row in m[:3]]; t = [row[3] for row in m[:3]]\n"
    centre += "for i in range(3): m[i][3] = -1e3 * sum(R[j][i] * t[j] for j in range(3))\n"
    (tmp_path / "program.py").write_text(f"{HOLD}{centre}{STREAM.format(each='pass')}")
    mine = 'mine = { kind = "external", command = ["python3", "program.py"] }\n'
    path.write_text(SMALL.replace("seeds = [0, 1]", "seeds = [0]") + mine)
    for _ in range(2):  # the second run finds it fresh
        assert bring_up_to("score", str(path), out, ExecutionOptions()) == 0
        said = capsys.readouterr().err
        assert "doubt: box-s0 mine@15hz: the first translation is 1,000 times" in said and "`uavbench check`" in said
        assert said.count("doubt:") == 1
