"""Compiled deflate (RFC 1951): literals and run-length matches at distance 1, dynamic Huffman codes per block."""

from typing import Any

import numpy as np

from uavbench.scenes.png.huffman import code_lengths, codes
from uavbench.trajectories.kernels.compiled import compiled

BLOCK = 1 << 17
"""Input bytes per block, some 68 rows of 640 x 3 bytes; the header with its codes takes 45 to 160 bytes."""
END = 256
"""Symbol of the end of a block, after those of the literals."""
SYMBOLS = 286
SHORTEST, LONGEST = 3, 258
"""Shortest and longest match of deflate (section 3.2.5)."""
TOKENS = END + LONGEST + 1
"""Tokens: literals, the end of a block, and END + n for a run of n bytes."""
CODE_BITS, META_BITS = 15, 7
"""Greatest lengths, in bits, of codes of symbols and of codes of code lengths (section 3.2.7)."""
META_ORDER = np.array([16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15], dtype=np.int64)
"""Order in which the lengths of the code length codes are written (section 3.2.7)."""


def room_words(size: int) -> int:
    """Upper bound of the 64-bit words in the compressed stream of `size` bytes."""
    blocks = -(-size // BLOCK)
    return size * (CODE_BITS + 1) // 64 + blocks * (SYMBOLS * META_BITS // 64 + 4) + 2


@compiled("u1 w1!")
def deflate(data: Any, out: Any) -> int:
    """Compress data (n,) of bytes into out (room_words,), least significant bit first; returns the number of bits."""
    tokens = np.empty(BLOCK, dtype=np.uint16)
    counts, lengths = np.empty(SYMBOLS, dtype=np.int64), np.empty(SYMBOLS, dtype=np.int64)
    symbol_codes = np.empty(SYMBOLS, dtype=np.uint64)
    words, bits = np.zeros(TOKENS, dtype=np.uint64), np.zeros(TOKENS, dtype=np.int64)
    at = 0
    for start in range(0, data.size, BLOCK):
        stop = min(start + BLOCK, data.size)
        number = _tokens(data, start, stop, tokens, counts)
        code_lengths(counts, CODE_BITS, lengths)
        codes(lengths, symbol_codes)
        at = _put(out, at, (2 << 1) | int(stop == data.size), 3)
        at = _put_lengths(out, at, lengths)
        _stream_words(lengths, symbol_codes, words, bits)
        at = _put_tokens(out, at, tokens[:number], words, bits)
        at = _put(out, at, words[END], bits[END])
    return at


@compiled
def _tokens(data: Any, start: int, stop: int, tokens: Any, counts: Any) -> int:
    """Tokenize data[start:stop] and count its symbols; returns the number of tokens."""
    counts[:] = 0
    number, i = 0, start
    while i < stop:
        value = data[i]
        # one branch instead of three, each of which would often be mispredicted for noisy images
        is_run = 0 < i < stop - 2 and (value ^ data[i - 1]) | (value ^ data[i + 1]) | (value ^ data[i + 2]) == 0
        if is_run:
            end, furthest = i + SHORTEST, min(stop, i + LONGEST)
            while end < furthest and data[end] == value:
                end += 1
            tokens[number] = END + end - i
            counts[_run_symbol(end - i)] += 1
            i = end
        else:
            tokens[number] = value
            counts[value] += 1
            i += 1
        number += 1
    counts[END] = 1
    return number


@compiled
def _run_extra(run: int) -> int:
    """Number of extra bits of a run length (section 3.2.5)."""
    extra = 0
    while run < LONGEST and (run - SHORTEST) >> (extra + 3):
        extra += 1
    return extra


@compiled
def _run_symbol(run: int) -> int:
    """Symbol of a run length (section 3.2.5)."""
    extra = _run_extra(run)
    return END + 1 + (28 if run == LONGEST else 4 * extra + ((run - SHORTEST) >> extra))


@compiled
def _stream_words(lengths: Any, symbol_codes: Any, words: Any, bits: Any) -> None:
    """Bit pattern and length of each token: for a run its code, its extra bits, and a 0 for distance 1."""
    words[: END + 1], bits[: END + 1] = symbol_codes[: END + 1], lengths[: END + 1]
    for run in range(SHORTEST, LONGEST + 1):
        symbol, extra = _run_symbol(run), _run_extra(run)
        rest = (run - SHORTEST) & ((1 << extra) - 1)
        words[END + run] = symbol_codes[symbol] | (np.uint64(rest) << np.uint64(lengths[symbol]))
        bits[END + run] = lengths[symbol] + extra + 1


@compiled
def _put_lengths(out: Any, at: int, lengths: Any) -> int:
    """Write the lengths of all codes, with one distance code of one bit (section 3.2.7); returns the next bit."""
    at = _put(out, at, SYMBOLS - 257, 5)
    at = _put(out, at, 0, 5)
    at = _put(out, at, META_ORDER.size - 4, 4)
    counts, meta = np.zeros(META_ORDER.size, dtype=np.int64), np.zeros(META_ORDER.size, dtype=np.int64)
    counts[1] = 1
    for length in lengths:
        counts[length] += 1
    code_lengths(counts, META_BITS, meta)
    meta_codes = np.empty(META_ORDER.size, dtype=np.uint64)
    codes(meta, meta_codes)
    for symbol in META_ORDER:
        at = _put(out, at, meta[symbol], 3)
    for length in lengths:
        at = _put(out, at, meta_codes[length], meta[length])
    return _put(out, at, meta_codes[1], meta[1])


@compiled
def _put(out: Any, at: int, word: int, count: int) -> int:
    """Write the lowest `count` bits of a word, whose other bits are 0, at bit `at`; returns the next bit."""
    k, shift = at >> 6, at & 63
    if shift == 0:
        out[k] = np.uint64(word)
    else:
        out[k] |= np.uint64(word) << np.uint64(shift)
        if shift + count > 64:
            out[k + 1] = np.uint64(word) >> np.uint64(64 - shift)
    return at + count


@compiled
def _put_tokens(out: Any, at: int, tokens: Any, words: Any, bits: Any) -> int:
    """Write the bit patterns of all tokens, as `_put` with the current output word buffered; returns the next bit."""
    k, fill = at >> 6, at & 63
    buffer = out[k] if fill else np.uint64(0)
    for token in tokens:
        word, count = words[token], bits[token]
        buffer |= word << np.uint64(fill)
        fill += count
        if fill >= 64:
            out[k] = buffer
            k += 1
            fill -= 64
            buffer = word >> np.uint64(count - fill)
    if fill:
        out[k] = buffer
    return 64 * k + fill
