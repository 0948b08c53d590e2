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
STRETCH = 32
"""Bytes that are looked through at once for runs: a vector of most processors."""
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
    tokens, tallies = np.empty(BLOCK, dtype=np.uint16), np.empty((4, TOKENS), dtype=np.int64)
    counts, lengths = np.empty(SYMBOLS, dtype=np.int64), np.empty(SYMBOLS, dtype=np.int64)
    symbol_codes = np.empty(SYMBOLS, dtype=np.uint64)
    words, bits = np.zeros(TOKENS, dtype=np.uint64), np.zeros(TOKENS, dtype=np.int64)
    at = 0
    for start in range(0, data.size, BLOCK):
        stop = min(start + BLOCK, data.size)
        number = _tokens(data, start, stop, tokens)
        _count(tokens[:number], tallies, counts)
        code_lengths(counts, CODE_BITS, lengths)
        codes(lengths, symbol_codes)
        at = _put(out, at, (2 << 1) | int(stop == data.size), 3)
        at = _put_lengths(out, at, lengths)
        _stream_words(lengths, symbol_codes, words, bits)
        at = _put_tokens(out, at, tokens[:number], words, bits)
        at = _put(out, at, words[END], bits[END])
    return at


@compiled("u1 i0 i0 h1!", inner=True, allocates=False)
def _tokens(data: Any, start: int, stop: int, tokens: Any) -> int:
    """Tokenize data[start:stop]; returns the number of tokens."""
    number, i = 0, start
    while i < stop:
        if 0 < i < stop - STRETCH - 2 and not _has_run(data, i):
            _copy(data, i, tokens, number)
            i += STRETCH
            number += STRETCH
            continue
        end = min(i + STRETCH, stop)
        while i < end:
            value = data[i]
            run = _run(data, i, stop)
            tokens[number] = END + run if run else value
            i += max(run, 1)
            number += 1
    return number


@compiled
def _has_run(data: Any, start: int) -> bool:
    """Whether a run begins in a stretch, of which one byte before and two after are there; without branches."""
    found, at, one, two = np.uint8(0), np.uint64(start), np.uint64(1), np.uint64(2)
    for k in range(np.uint64(STRETCH)):  # places without a sign, which need no check for one below 0
        here = data[at + k]
        unlike = (here ^ data[at + k - one]) | (here ^ data[at + k + one]) | (here ^ data[at + k + two])
        found |= np.uint8(unlike == 0)
    return bool(found != 0)


@compiled
def _copy(data: Any, start: int, tokens: Any, number: int) -> None:
    """A stretch of literals as tokens."""
    at, into = np.uint64(start), np.uint64(number)
    for k in range(np.uint64(STRETCH)):
        tokens[into + k] = data[at + k]


@compiled
def _run(data: Any, i: int, stop: int) -> int:
    """Length of the run that begins at a place: bytes like the one before; 0 for less than the shortest match."""
    value = data[i]
    # one branch instead of three, each of which would often be mispredicted for noisy images
    if not (0 < i < stop - 2 and (value ^ data[i - 1]) | (value ^ data[i + 1]) | (value ^ data[i + 2]) == 0):
        return 0
    end, furthest = i + SHORTEST, min(stop, i + LONGEST)
    while end < furthest and data[end] == value:
        end += 1
    return end - i


@compiled("h1 i2! i1!", inner=True, allocates=False)
def _count(tokens: Any, tallies: Any, counts: Any) -> None:
    """Count the symbols of tokens, in turns in four tallies (4, TOKENS): a count need not wait for the one before."""
    tallies[:] = 0
    whole = tokens.size - tokens.size % 4
    for i in range(0, whole, 4):
        tallies[0, tokens[i]] += 1
        tallies[1, tokens[i + 1]] += 1
        tallies[2, tokens[i + 2]] += 1
        tallies[3, tokens[i + 3]] += 1
    for i in range(whole, tokens.size):
        tallies[0, tokens[i]] += 1
    counts[:] = 0
    for token in range(TOKENS):
        symbol = token if token < END + SHORTEST else _run_symbol(token - END)
        for k in range(4):
            counts[symbol] += tallies[k, token]
    counts[END] = 1


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


@compiled("w1! i0 h1 w1 i1", inner=True, allocates=False)
def _put_tokens(out: Any, at: int, tokens: Any, words: Any, bits: Any) -> int:
    """Write the bit patterns of all tokens, as `_put` with the current output word buffered; returns the next bit.

    Three at once, which have at most 63 bits: a word is full less often than not, which is predicted.
    """
    k, fill = at >> 6, at & 63
    buffer = out[k] if fill else np.uint64(0)
    whole = tokens.size - tokens.size % 3
    for i in range(0, whole, 3):
        first, second, third = tokens[i], tokens[i + 1], tokens[i + 2]
        count = bits[first] + bits[second]
        word = words[first] | (words[second] << np.uint64(bits[first])) | (words[third] << np.uint64(count))
        count += bits[third]
        buffer |= word << np.uint64(fill)
        fill += count
        if fill >= 64:
            out[k] = buffer
            k += 1
            fill -= 64
            buffer = word >> np.uint64(count - fill)
    if fill:
        out[k] = buffer
    at = 64 * k + fill
    for i in range(whole, tokens.size):
        at = _put(out, at, words[tokens[i]], bits[tokens[i]])
    return at
