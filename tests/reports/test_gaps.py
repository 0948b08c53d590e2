"""Lines of figures of `uavbench evaluate` end where the estimate has no pose."""

import numpy as np
import pytest

from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.reports.evaluation.gaps import longest_step_ns, with_gaps
from uavbench.reports.many_runs.evaluate_many import evaluate_many
from uavbench.reports.many_runs.figures import draw_paths
from uavbench.reports.many_runs.groups import Run
from uavbench.reports.style import new_figure


def test_no_figure_draws_a_line_over_frames_without_a_pose(tmp_path):
    seconds = np.arange(0, 10, 0.1)
    still = np.zeros((100, 3))
    truth = np.column_stack([seconds, np.cos(seconds), np.sin(seconds), seconds, still, still[:, 0] + 1])
    kept = (seconds < 2) | (np.abs(seconds - 4) < 0.01) | (seconds > 6)
    np.savetxt(tmp_path / "truth.tum", truth)
    np.savetxt(tmp_path / "run.tum", truth[kept] + [0, 0.1, 0, 0, 0, 0, 0, 0])
    found = evaluate_files(tmp_path / "truth.tum", tmp_path / "run.tum")
    many = evaluate_many(tmp_path / "truth.tum", [Run("a", "run", tmp_path / "run.tum")])
    panels = new_figure(3.0).subplots(1, 4)
    found.plot(panels[0])
    found.plot(panels[1], "rotation")
    found.plot(panels[2], "path")
    draw_paths(many, panels[3])
    estimates = [panel.lines[k] for panel, k in zip(panels, (0, 0, 1, 1), strict=True)]
    for drawn in estimates:
        lost = np.flatnonzero(np.isnan(drawn.get_ydata()))
        assert lost.tolist() == [20, 22] and drawn.get_markevery() == [21]


@pytest.mark.parametrize(("stamps", "asked", "gaps"), [
    ([0, 1, 2, 3, 4, 6, 7], None, 0),  # keyframes
    ([0, 1, 2, 3, 4, 6, 7], [*range(8)], 1),
    ([0, 10, 20, 30], [*range(31)], 0),  # of a ground truth of a tenth of the rate
    ([0, 1, 1, 1, 1, 2, 3], None, 0),
    ([0], None, 0),
    ([0, 1, 2, 3, 4, 9], None, 1),
])  # fmt: skip
def test_a_gap_is_a_step_over_lost_frames(stamps, asked, gaps):
    stamps_ns = np.array(stamps)
    longest_ns = longest_step_ns(stamps_ns, None if asked is None else np.array(asked))
    assert np.isnan(with_gaps(stamps_ns, stamps_ns, longest_ns)).sum() == gaps
