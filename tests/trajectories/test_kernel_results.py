"""What kernels return to Python: classes, values and memory."""

import gc
import sys
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys
from numpy.typing import NDArray

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, unchecked
from uavbench.trajectories.pose import Array


class Inner(NamedTuple):
    """A tuple in another one: an array that is given, and one that is made."""

    given: Array
    made: NDArray[np.int64]


class Outer(NamedTuple):
    """Numbers of several types, and tuples."""

    inner: Inner
    number: float
    count: int
    flag: bool
    pair: tuple[int, float]


class Alike(NamedTuple):
    """Fields of one type, which numba keeps in an array."""

    first: float
    second: float


@compiled("f1 i0")
def nested(given: Array, count: int) -> Outer:
    """A tuple of everything."""
    made = np.zeros((count, 2), np.int64)
    for i in range(count):
        made[i, 1] = i
    return Outer(Inner(given, made), given.sum(), count, count > 2, (count, 0.5))


@compiled("f0")
def alike(value: float) -> Alike:
    """A tuple of equal types."""
    return Alike(value, 2.0 * value)


@compiled("i0")
def empty(count: int) -> Array:
    """An array alone."""
    return np.zeros((count, 3))


INNER, PAIR = named_tuple(Inner, "f1! i2!"), numba.types.Tuple([numba.int64, numba.float64])
OUTER = named_tuple(Outer, "inner f0 i0 b0 pair", inner=INNER, pair=PAIR)


@compiled("outer", outer=OUTER)
def parts(outer: Outer) -> tuple[Inner, Array, Array, float]:
    """Parts and views of an argument, of which one is read again and again."""
    inner, (count, _), total = outer.inner, outer.pair, 0.0
    given, row, last = inner.given, inner.made[0], inner.given
    for i in range(count):
        row = inner.made[i]
        last = given[i:]
        total += last[0] * float(row[1])
    return inner, row[:1], last, total


@pytest.mark.parametrize("call", [nested, unchecked(nested)])
def test_named_tuples_come_back_as_they_are_declared(call):
    given = np.array([1.0, 2.0])
    got = call(given, 3)
    assert type(got) is Outer and type(got.inner) is Inner
    assert got.inner.given is given
    np.testing.assert_array_equal(got.inner.made, [[0, 0], [0, 1], [0, 2]])
    assert got.inner.made.dtype == np.int64 and got.inner.made.flags.writeable and got.inner.made.flags.c_contiguous
    assert got[1:] == (3.0, 3, True, (3, 0.5)) and type(got.flag) is bool and type(got.count) is int
    assert got._replace(count=1).count == 1 and Outer._fields == ("inner", "number", "count", "flag", "pair")


def test_fields_of_one_type():
    got = alike(1.5)
    assert type(got) is Alike and got == (1.5, 3.0)


def test_the_collector_sees_what_a_tuple_holds():
    kept = nested(np.ones(2), 2)
    assert gc.is_tracked(kept) and any(each is kept.inner for each in gc.get_referents(kept))


@pytest.fixture
def statistics():
    """numba's counts of allocations, while they are counted."""
    _nrt_python.memsys_enable_stats()
    yield rtsys.get_allocation_stats
    _nrt_python.memsys_disable_stats()


def test_memory_is_freed_when_results_are(statistics):
    given = np.ones(4)
    nested(given, 4)
    before = statistics()
    for _ in range(200):
        nested(given, 4)
        empty(5)
    after = statistics()
    assert after.alloc - before.alloc >= 400
    assert after.alloc - before.alloc == after.free - before.free
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free
    kept = [empty(5) for _ in range(7)]
    held = statistics()
    assert (held.alloc - held.free) - (after.alloc - after.free) == len(kept)


def test_parts_of_an_argument_outlive_the_call_and_no_more(statistics):
    outer = nested(np.array([1.0, 2.0, 4.0]), 3)
    arrays = outer.inner.given, outer.inner.made
    references, before = [sys.getrefcount(each) for each in arrays], statistics()
    for _ in range(100):
        inner, row, last, total = parts(outer)
    assert inner.given is arrays[0] and row.tolist() == [0] and last.tolist() == [4.0] and total == 10.0
    del inner
    assert row.base is not None and [sys.getrefcount(each) for each in arrays] != references
    del row, last
    after = statistics()
    assert [sys.getrefcount(each) for each in arrays] == references
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free
    assert outer.inner.made.tolist() == [[0, 0], [0, 1], [0, 2]]


def test_errors_of_kernels_come_through():
    with pytest.raises((ValueError, MemoryError)):
        empty(-1)
