"""Seeds repeat another one where the frames and results of every run are equal."""

from uavbench.reports.statistics.repeats import Observation, Repeats


def one(seed, seen, run="lsd@15hz", flight="box"):
    return Observation(run, flight, seed, seen)


def test_seeds_repeat_where_all_runs_saw_the_same():
    assert Repeats.of([one(2, "a"), one(0, "a"), one(1, "b"), one(3, "b"), one(4, "c")]).groups == {
        "box": ((0, 2), (1, 3))
    }
    random = [one(seed, "a") for seed in range(3)] + [one(seed, str(seed), "robust@15hz") for seed in range(3)]
    assert not Repeats.of(random).groups, "a tracker with random numbers has replicates of its own"
    assert not Repeats.of([one(0, None), one(1, None)]).groups
    assert not Repeats.of([one(0, "a"), one(1, "a", flight="wall")]).groups
    missing = [one(0, "a"), one(1, "a"), one(0, "b", "robust@15hz")]
    assert not Repeats.of(missing).groups


def test_repeats_are_named_with_what_to_do():
    assert str(Repeats()) == ""
    many = Repeats.of(one(seed, "a", flight=f"f{k}") for k in range(5) for seed in (0, 1))
    assert str(many).startswith("f0: seeds 0 and 1; f1: seeds 0 and 1; f2: seeds 0 and 1 and 2 more have the same")
    assert many.counts("f0", 0) and not many.counts("f0", 1) and many.counts("wall", 1)
