"""Comparisons of many bytes or numbers at once: the bits of their words are in the order of memory."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.equal_bytes import AT_ONCE, BITS, bit_number, equal_bytes, unlike


@compiled("u1 w0 w0")
def compared(data: Any, one: Any, other: Any) -> Any:
    """64 bytes by the processor's instruction."""
    return equal_bytes(data, one, other)


@compiled("u1 w0 w0 i0")
def unlike_numbers(data: Any, one: Any, other: Any, count: int) -> Any:
    """At most AT_ONCE numbers of 32 bits."""
    return unlike(data, one, other, count)


@compiled("w0")
def number(single: Any) -> Any:
    """Number of a bit."""
    return bit_number(single)


@pytest.mark.parametrize("compare", [equal_bytes, compared], ids=["by numpy", "by one instruction"])
def test_the_bits_of_a_comparison_are_in_the_order_of_the_bytes(compare: Callable[..., Any]) -> None:
    data = np.zeros(200, dtype=np.uint8)
    data[[7, 50, 70]] = 1, 2, 3
    assert int(compare(data, np.uint64(5), np.uint64(69))) == 2**BITS - 1 - (1 << 2 | 1 << 45 | 1 << 1)


@pytest.mark.parametrize("count", [0, 1, AT_ONCE - 1, AT_ONCE])
@pytest.mark.parametrize("byte", range(4))
def test_numbers_differ_where_any_of_their_bytes_does(count: int, byte: int) -> None:
    data = np.zeros(8 * AT_ONCE, dtype=np.uint8)
    data[[byte, 4 * 14 + byte, 4 * 15 + byte]] = 1, 128, 7
    expected = sum(1 << 4 * k for k in (0, 14, 15) if k < count)
    assert int(unlike_numbers(data, np.uint64(0), np.uint64(4 * AT_ONCE), count)) == expected


def test_the_number_of_each_bit_is_known() -> None:
    assert [int(number(np.uint64(1 << k))) for k in range(BITS)] == list(range(BITS))
