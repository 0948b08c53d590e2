"""A kernel that counts no references to its arguments neither frees nor keeps what it returns, holds or names anew."""

import sys
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined, unchecked
from uavbench.trajectories.pose import Array

CALLS = 50


class Pair(NamedTuple):
    """Two arrays."""

    first: Array
    second: Array


class Nest(NamedTuple):
    """Two arrays in a tuple, and one beside."""

    pair: Pair
    other: Array


PAIR = named_tuple(Pair, "f1! f1!")
NEST = named_tuple(Nest, "pair f1!", pair=PAIR)


@compiled("nest i0", nest=NEST)
def one_of(nest: Nest, which: int) -> Array:
    """An argument's part, chosen by branches."""
    found = nest.other
    if which == 0:
        found = nest.pair.first
    elif which == 1:
        pair = nest.pair
        found = pair.second
    return found


@compiled("nest i0", nest=NEST)
def made_or_given(nest: Nest, which: int) -> Array:
    """An array that one branch makes and another is given."""
    if which == 0:
        return nest.pair.first
    return nest.pair.second if which == 1 else nest.other + 1.0


@compiled("f1 f1")
def renamed(a: Array, b: Array) -> Array:
    """Arguments whose names are given to others, and to what is made."""
    keep = a
    a = b
    b = keep
    b = b + a
    return np.concatenate((keep, a, b))


@compiled("f1 f1 i0")
def in_turn(a: Array, b: Array, count: int) -> tuple[Array, Array]:
    """Arguments that change places in a loop."""
    for _ in range(count):
        a, b = b, a
    return a, b


@compiled("f1 i0")
def ever_shorter(values: Array, count: int) -> Array:
    """Views of views, of which each has the name of the last."""
    for _ in range(count):
        values = values[1:]
    return values


@compiled("f1 i0")
def made_anew(values: Array, count: int) -> Array:
    """An argument in whose place a loop puts what it makes, and views of that."""
    last = values
    for i in range(count):
        last = values[:1]
        values = np.arange(2.0 + i)
        last = values[1:]
    return last


@compiled("f1")
def view_of_own(values: Array) -> Array:
    """A view of what is made, whose own name is given to another."""
    own = values * 2.0
    part = own[1:]
    own = values[:1] * 3.0
    return part + own[0]


@compiled("nest", nest=NEST)
def packed(nest: Nest) -> tuple[Nest, Pair, tuple[Array, Array]]:
    """Tuples of arguments, parts, views and what is made."""
    pair, other = nest.pair, nest.other
    mixed = Pair(other[1:], pair.first + 1.0)
    return Nest(Pair(pair.second, pair.first), other), mixed, (mixed.first[1:], mixed.second)


@compiled("f1 f1", inner=True)
def swapped(a: Array, b: Array) -> Pair:
    """A tuple of arguments the other way round, for a kernel."""
    return Pair(b, a)


@inlined
def itself(values: Array) -> Array:
    """What is given."""
    return values


@compiled("f1")
def through_others(values: Array) -> Array:
    """Arrays that other kernels return, which they were given, of which this one has no other name."""
    pair = swapped(values + 1.0, itself(values))
    pair = swapped(itself(pair.first)[1:], pair.second)
    noise = np.full(len(values), -1.0)
    return itself(pair.first) + noise[0]


@compiled
def taken_out(held: Any, values: Array) -> Array:
    """What a list held before something else was put in its place."""
    first = held[0]
    held[0] = values * 0.0
    one, other = np.full(len(values), 1.0), np.full(len(values), 1.0)  # in the place of what was freed too early
    return first + one[0] * other[0]


@compiled("f1")
def of_a_list(values: Array) -> Array:
    """What was the only holder of an array."""
    return taken_out([values + 1.0], values)


@compiled("(f1! f1!) i0")
def of_equals(pair: tuple[Array, Array], which: int) -> Array:
    """One of a tuple's parts, by a number."""
    found = pair[which]
    for each in pair:
        if len(each) > len(found):
            found = each
    return found


@compiled("f2")
def rows(table: Array) -> tuple[Array, Array, Array]:
    """Rows, by unpacking, by a number and by a list of them, which is a copy."""
    first, second = table
    total = np.zeros(table.shape[1])
    for row in table:
        total += row
    copies = table[np.array([1, 0])]
    return first + total, second[1:], copies[0]


def nest() -> Nest:
    """Three arrays."""
    return Nest(Pair(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])), np.array([7.0, 8.0, 9.0]))


A, B, C = (each.tolist() for each in (*nest().pair, nest().other))


def lists(value: Any) -> Any:
    """Lists in place of arrays."""
    return value.tolist() if isinstance(value, np.ndarray) else [lists(each) for each in value]


CASES: list[tuple[Callable[..., Any], Callable[[Nest], tuple[Any, ...]], Any]] = [
    (one_of, lambda n: (n, 0), A),
    (one_of, lambda n: (n, 1), B),
    (one_of, lambda n: (n, 2), C),
    (made_or_given, lambda n: (n, 0), A),
    (made_or_given, lambda n: (n, 1), B),
    (made_or_given, lambda n: (n, 2), [8.0, 9.0, 10.0]),
    (renamed, lambda n: n.pair, [*A, *B, 5.0, 7.0, 9.0]),
    (in_turn, lambda n: (*n.pair, 3), [B, A]),
    (in_turn, lambda n: (*n.pair, 0), [A, B]),
    (ever_shorter, lambda n: (n.other, 2), [9.0]),
    (ever_shorter, lambda n: (n.other, 0), C),
    (made_anew, lambda n: (n.other, 0), C),
    (made_anew, lambda n: (n.other, 3), [1.0, 2.0, 3.0]),
    (view_of_own, lambda n: (n.other,), [37.0, 39.0]),
    (packed, lambda n: (n,), [[[B, A], C], [C[1:], [2.0, 3.0, 4.0]], [C[2:], [2.0, 3.0, 4.0]]]),
    (through_others, lambda n: (n.pair.first,), A),
    (of_a_list, lambda n: (n.pair.first,), [3.0, 4.0, 5.0]),
    (of_equals, lambda n: (tuple(n.pair), 1), B),
    (of_equals, lambda n: (tuple(n.pair), -2), A),
    (rows, lambda n: (np.array(n.pair),), [[6.0, 9.0, 12.0], [5.0, 6.0], B]),
]


@pytest.fixture
def statistics() -> Iterator[Callable[[], Any]]:
    """numba's counts of allocations, while they are counted."""
    _nrt_python.memsys_enable_stats()
    yield rtsys.get_allocation_stats
    _nrt_python.memsys_disable_stats()


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize("code", [lambda kernel: kernel, unchecked], ids=["checked", "unchecked"])
@pytest.mark.parametrize(("kernel", "arguments", "expected"), CASES, ids=lambda value: getattr(value, "__name__", ""))
def test_what_is_returned_is_held_and_freed_once(kernel, arguments, expected, code, statistics):
    given, call = nest(), code(kernel)
    arrays = *given.pair, given.other
    assert lists(call(*arguments(given))) == expected
    references, before = [sys.getrefcount(each) for each in arrays], statistics()
    kept = [call(*arguments(given)) for _ in range(CALLS)]
    freed = [np.full(3, -7.0) for _ in range(CALLS)]  # in the place of what was freed too early
    assert all(lists(each) == expected for each in kept) and len(freed) == CALLS
    assert lists(given) == [[A, B], C]
    del kept
    after = statistics()
    assert [sys.getrefcount(each) for each in arrays] == references
    assert after.alloc - before.alloc == after.free - before.free
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free
    assert lists(given) == [[A, B], C]


def test_results_outlive_what_was_given():
    kept = [(one_of(nest(), i % 3), packed(nest()), in_turn(*nest().pair, i % 2)) for i in range(CALLS)]
    fresh = [nest() for _ in range(CALLS)]
    for i, (part, tuples, pair) in enumerate(kept):
        assert lists(part) == [A, B, C][i % 3]
        assert lists(tuples)[0] == [[B, A], C]
        assert lists(pair) == ([B, A] if i % 2 else [A, B])
    assert len(fresh) == CALLS
