"""Exact tests of a loss: known p, and no more false alarms than they say, whatever makes runs lose frames."""

import numpy as np
import pytest

from uavbench.reports.statistics.bootstrap import sign_flip_p
from uavbench.reports.statistics.losses import exchange_p, loss_p, smallest_loss_p


def test_p_of_known_cases():
    base, head = np.array([1.0, 0.99, 0.98, 0.97, 0.96]), np.array([0.3, 0.2, 0.4, 0.1, 0.25])
    assert exchange_p(base, head) == 1 / 252
    assert exchange_p(head, base) == 1.0
    assert exchange_p(base, base) > 0.5
    assert loss_p([base], [head]) == 2 / 252 == smallest_loss_p(1, 5)
    assert loss_p([base, base], [head, head]) == sign_flip_p(np.concatenate([base - head, base - head]))
    assert (smallest_loss_p(1, 1), smallest_loss_p(2, 5)) == (1.0, 2**-10)


def test_p_of_many_runs_is_drawn():
    base = np.linspace(0.9, 1.0, 12)
    assert exchange_p(base, base - 0.5) == 1 / 20_001 == exchange_p(base, base - 0.5, seed=0)
    assert exchange_p(base - 0.5, base) == 1.0
    assert loss_p([base], [base - 0.005]) < 0.001, "small beside the spread, but of all pairs"
    assert exchange_p(base, base - 0.005) > 0.3


CAUSES = {
    "a rare event": lambda rng, n: 1 - 0.7 * (rng.random((2, n)) < 0.3),
    "frames that are hard or not": lambda rng, n: 1 - 0.7 * (rng.random((2, n)) < rng.beta(0.3, 0.3, n)),
    "frames and chance": lambda rng, n: rng.normal(0, 0.1, n) + rng.normal(0, 0.1, (2, n)),
    "chance alone": lambda rng, n: rng.normal(0, 0.1, (2, n)),
    "chance on some frames": lambda rng, n: rng.choice([0.001, 1], n) * rng.normal(0, 0.1, (2, n)),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_runs_of_the_same_code_are_told_apart_no_more_often_than_p_says(cause):
    rng = np.random.default_rng(0)
    found = np.array([loss_p([base], [head]) for base, head in (CAUSES[cause](rng, 5) for _ in range(600))])
    for level in (0.02, 0.05):
        assert (found <= level).mean() <= level + 3 * np.sqrt(level * (1 - level) / len(found))
