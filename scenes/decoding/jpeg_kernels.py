"""Compiled walk through the Huffman codes of a JPEG scan, without decoding its pixels (ITU-T T.81, annex F)."""

from typing import Any

from uavbench.trajectories.kernels.compiled import compiled

END_OF_BLOCK, ZEROS = 0, 0xF0
"""Symbols of AC coefficients: all others are zero, and so are the next 16."""


@compiled("u1 j2 i2 i0")
def bits_of_blocks(data: Any, codes: Any, tables: Any, mcus: int) -> int:
    """Bits that so many MCUs take; -1 when a code is invalid, or the data end before.

    data: bytes of an entropy-coded segment without stuffing; codes (tables, 65536): 256 * length + symbol of the code
    that begins with these 16 bits, 0 where there is none; tables (blocks, 2): rows of codes for the DC and AC
    coefficients of each block of an MCU.
    """
    at, bits = 0, 8 * data.size
    for _ in range(mcus):
        for block in range(tables.shape[0]):
            k = 0
            while k < 64:
                code = codes[tables[block, min(k, 1)], _next_16(data, at)]
                if code == 0:
                    return -1
                symbol = code & 255
                at += code >> 8
                if k == 0:
                    at += symbol
                    k = 1
                elif symbol == ZEROS:
                    k += 16
                elif symbol & 15 == END_OF_BLOCK:
                    break
                else:
                    k += (symbol >> 4) + 1
                    at += symbol & 15
                if at > bits or k > 64:
                    return -1
            if at > bits:
                return -1
    return at


@compiled
def _next_16(data: Any, at: int) -> int:
    """The 16 bits from a bit on, with ones beyond the end, as the last byte is filled up with."""
    first = at >> 3
    word = 0
    for k in range(3):
        word = word << 8 | (data[first + k] if first + k < data.size else 255)
    return (word >> (8 - (at & 7))) & 0xFFFF
