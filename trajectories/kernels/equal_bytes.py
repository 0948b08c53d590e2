"""Comparison of 64 bytes with 64 others into the bits of a word, and what processors do with bits and bytes at once."""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import extending
from numba.core import cgutils, types

from uavbench.trajectories.kernels.compiled import inlined

numba: Any = extending
fields_of: Any = cgutils.create_struct_proxy
BITS = 64
"""Bits of a word."""
AT_ONCE = BITS // 4
"""Numbers of 32 bits that are compared at once."""
COPIED = 32
"""Bytes that are copied at once: more than there are literals between most matches of an image."""
LOWEST = np.uint64(0x1111111111111111)
"""Lowest bit of each four."""


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


def lowest_bit(word: Any) -> Any:
    """Number of the lowest bit of a word that is set; of none, BITS."""
    return np.uint64((int(word) & -int(word)).bit_length() - 1 if word else BITS)


def set_bits(word: Any) -> Any:
    """How many bits of a word are set."""
    return np.uint64(int(word).bit_count())


def _by_one_instruction(of: str, *constants: Any) -> Any:
    """Function of a word that kernels compute by an instruction of LLVM's."""

    def typed(context: Any, word: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return getattr(builder, of)(*arguments, *constants)

        return types.uint64(types.uint64), code

    instruction = numba.intrinsic(typed)

    def for_kernels(word: Any) -> Any:
        def compiled(word: Any) -> Any:
            return instruction(word)

        return compiled

    return for_kernels


numba.overload(lowest_bit)(_by_one_instruction("cttz", ir.Constant(ir.IntType(1), 0)))
numba.overload(set_bits)(_by_one_instruction("ctpop"))


def copy_bytes(data: Any, one: Any, out: Any, other: Any) -> Any:
    """Copy COPIED bytes from a place on to numbers of 16 bits from another place on."""
    out[int(other) : int(other) + COPIED] = data[int(one) : int(one) + COPIED]


def _copy_typed(context: Any, data: Any, one: Any, out: Any, other: Any) -> Any:
    """Signature of the copy, and its code: one vector, which LLVM does not make of all loops that copy as many."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        arrays = [fields_of(signature.args[k])(context, builder, arguments[k]).data for k in (0, 2)]
        vectors = [ir.VectorType(ir.IntType(bits), COPIED) for bits in (8, 16)]
        source, target = (
            builder.bitcast(builder.gep(array, [place]), vector.as_pointer())
            for array, place, vector in zip(arrays, arguments[1::2], vectors, strict=True)
        )
        builder.store(builder.zext(builder.load(source, align=1), vectors[1]), target, align=1)
        return context.get_dummy_value()

    return types.void(data, types.uint64, out, types.uint64), code


_copy = numba.intrinsic(_copy_typed)


def _copy_for_kernels(data: Any, one: Any, out: Any, other: Any) -> Any:
    def compiled(data: Any, one: Any, out: Any, other: Any) -> Any:
        return _copy(data, one, out, other)

    return compiled


numba.overload(copy_bytes)(_copy_for_kernels)


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
