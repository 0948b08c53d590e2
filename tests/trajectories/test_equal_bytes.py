"""Comparisons of many bytes or numbers at once: the bits of their words are in the order of memory."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.equal_bytes import (
    AT_ONCE,
    BITS,
    COPIED,
    copy_bytes,
    equal_bytes,
    lowest_bit,
    set_bits,
    unlike,
)


@compiled("u1 w0 w0")
def compared(data: Any, one: Any, other: Any) -> Any:
    """64 bytes by the processor's instruction."""
    return equal_bytes(data, one, other)


@compiled("u1 w0 w0 i0")
def unlike_numbers(data: Any, one: Any, other: Any, count: int) -> Any:
    """At most AT_ONCE numbers of 32 bits."""
    return unlike(data, one, other, count)


@compiled("w0")
def lowest(word: Any) -> Any:
    """The lowest bit by the processor's instruction."""
    return lowest_bit(word)


@compiled("w0")
def number_set(word: Any) -> Any:
    """The number of bits by the processor's instruction."""
    return set_bits(word)


@compiled("u1 w0 h1! w0")
def copied(data: Any, one: Any, out: Any, other: Any) -> None:
    """Bytes as one vector."""
    copy_bytes(data, one, out, other)


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


@pytest.mark.parametrize("bit", [lowest_bit, lowest], ids=["by Python", "by one instruction"])
def test_the_lowest_bit_of_a_word_is_known(bit: Callable[..., Any]) -> None:
    assert [int(bit(np.uint64(1 << k))) for k in range(BITS)] == list(range(BITS))
    assert int(bit(np.uint64(0xFF00_0000_0000_0000 | 1 << 21))) == 21
    assert int(bit(np.uint64(0))) == BITS


@pytest.mark.parametrize("count", [set_bits, number_set], ids=["by Python", "by one instruction"])
def test_the_bits_of_a_word_are_counted(count: Callable[..., Any]) -> None:
    assert [int(count(np.uint64(word))) for word in (0, 1 << 63, 0b10110, 2**BITS - 1)] == [0, 1, 3, BITS]


@pytest.mark.parametrize("copy", [copy_bytes, copied], ids=["by numpy", "as one vector"])
def test_bytes_are_copied_to_numbers_of_16_bits(copy: Callable[..., Any]) -> None:
    data, out = np.arange(100, 250, dtype=np.uint8), np.full(100, 0x5A5A, dtype=np.uint16)
    copy(data, np.uint64(101), out, np.uint64(7))
    assert out[7 : 7 + COPIED].tolist() == data[101 : 101 + COPIED].tolist()
    assert set(out[:7].tolist() + out[7 + COPIED :].tolist()) == {0x5A5A}
