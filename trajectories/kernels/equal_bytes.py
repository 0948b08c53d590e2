"""Comparison of 64 bytes with 64 others into the bits of a word, for which processors have instructions."""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import extending
from numba.core import cgutils, types

from uavbench.trajectories.kernels.compiled import compiled, inlined

numba: Any = extending
fields_of: Any = cgutils.create_struct_proxy
BITS = 64
"""Bits of a word."""
AT_ONCE = BITS // 4
"""Numbers of 32 bits that are compared at once."""
LOWEST = np.uint64(0x1111111111111111)
"""Lowest bit of each four."""
SINGLE = np.uint64(0x03F79D71B4CB0A89)
"""Factor whose products with 2^0 .. 2^63 differ in their highest six bits (Leiserson, Prokop & Randall 1998)."""
PLACES = np.zeros(BITS, dtype=np.uint8)
"""Number of a single bit by those six bits."""
PLACES[[(int(SINGLE) << k & 2**BITS - 1) >> 58 for k in range(BITS)]] = np.arange(BITS)


def equal_bytes(data: Any, one: Any, other: Any) -> Any:
    """Word whose bit k tells whether data[one + k] == data[other + k]; the places are of 64 bits, without a sign."""
    same = data[int(one) : int(one) + BITS] == data[int(other) : int(other) + BITS]
    return np.packbits(same, bitorder="little").view(np.uint64)[0]


def _typed(context: Any, data: Any, one: Any, other: Any) -> Any:
    """Signature of the comparison, and its code in LLVM's language: of two vectors, the results read as one number."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, *places = arguments
        first = fields_of(signature.args[0])(context, builder, array).data
        vector = ir.VectorType(ir.IntType(8), BITS)
        pointers = [builder.bitcast(builder.gep(first, [place]), vector.as_pointer()) for place in places]
        here, there = (builder.load(pointer, align=1) for pointer in pointers)
        return builder.bitcast(builder.icmp_unsigned("==", here, there), ir.IntType(BITS))

    return types.uint64(data, types.uint64, types.uint64), code


_compare = numba.intrinsic(_typed)


def _for_kernels(data: Any, one: Any, other: Any) -> Any:
    """How kernels compare: no loop of numba's becomes these instructions."""

    def compiled(data: Any, one: Any, other: Any) -> Any:
        return _compare(data, one, other)

    return compiled


numba.overload(equal_bytes)(_for_kernels)


@compiled
def bit_number(single: Any) -> Any:
    """The number of the only bit of a word that is set."""
    return PLACES[(single * SINGLE) >> np.uint64(58)]


@inlined
def unlike(data: Any, one: Any, other: Any, count: int) -> Any:
    """Word whose bit 4 k tells whether the numbers of 32 bits k after two places in bytes differ, of up to AT_ONCE."""
    if count == AT_ONCE:
        differ = ~equal_bytes(data, one, other)
        differ |= differ >> np.uint64(2)
        return (differ | (differ >> np.uint64(1))) & LOWEST
    word = np.uint64(0)
    for k in range(np.uint64(4 * count)):
        if data[one + k] != data[other + k]:
            word |= np.uint64(1) << (k & ~np.uint64(3))
    return word
