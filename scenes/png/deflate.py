"""Compiled deflate (RFC 1951): literals and matches at one distance, dynamic Huffman codes per block."""

from typing import Any, NamedTuple

import numpy as np

from uavbench.scenes.png.checksum import adler32
from uavbench.scenes.png.huffman import code_lengths, codes
from uavbench.scenes.png.matches import AT_ONCE, find_matches
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.equal_bytes import BITS, COPIED, copy_bytes

BLOCK = 1 << 17
"""Input bytes per block, some 68 rows of 640 x 3 bytes; the header with its codes takes 45 to 160 bytes."""
END = 256
"""Symbol of the end of a block, after those of the literals."""
SYMBOLS = 286
SHORTEST, LONGEST = 3, 258
"""Shortest and longest match of deflate (section 3.2.5)."""
MOST_DISTANT = 8
"""Greatest distance of matches here: one extra bit is enough (section 3.2.5)."""
TOKENS = END + LONGEST + 1
"""Tokens: literals, the end of a block, and END + n for a match of n bytes."""
CODE_BITS, META_BITS = 15, 7
"""Greatest lengths, in bits, of codes of symbols and of codes of code lengths (section 3.2.7)."""
META_ORDER = np.array([16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15], dtype=np.int64)
"""Order in which the lengths of the code length codes are written (section 3.2.7)."""


def room_words(size: int) -> int:
    """Upper bound of the 64-bit words in the compressed stream of `size` bytes."""
    blocks = -(-size // BLOCK)
    return size * (CODE_BITS + 1) // 64 + blocks * (SYMBOLS * META_BITS // 64 + 4) + 2


def _extra(length: int) -> int:
    """Number of extra bits of the length of a match (section 3.2.5)."""
    return 0 if length == LONGEST else max((length - SHORTEST).bit_length() - 3, 0)


def _symbol(length: int) -> int:
    """Symbol of the length of a match (section 3.2.5)."""
    extra = _extra(length)
    return END + 1 + (28 if length == LONGEST else 4 * extra + ((length - SHORTEST) >> extra))


LENGTHS = range(SHORTEST, LONGEST + 1)
EXTRA = np.array([0] * SHORTEST + [_extra(length) for length in LENGTHS], dtype=np.int64)
"""Number of extra bits of each length of a match."""
SYMBOL_OF = np.array([*range(END + SHORTEST), *map(_symbol, LENGTHS)], dtype=np.int64)
"""Symbol of each token."""


class Deflated(NamedTuple):
    """Number of bits of a compressed stream, and the Adler-32 checksum of its data."""

    bits: int
    checksum: int


@compiled("u1 i0 w1!")
def deflate(data: Any, distance: int, out: Any) -> Deflated:
    """Compress data (n,) of bytes into out (room_words,), least significant bit first.

    Bytes that are like those a distance before, 1 to MOST_DISTANT, are replaced by their number.
    """
    tokens, tallies = np.empty(BLOCK + COPIED, dtype=np.uint16), np.empty((4, TOKENS), dtype=np.int64)
    masks, threes = np.empty(BLOCK // BITS + 1, dtype=np.uint64), np.empty(BLOCK // BITS + 1, dtype=np.uint64)
    places = np.empty(BLOCK + AT_ONCE, dtype=np.int64)
    counts, lengths = np.empty(SYMBOLS, dtype=np.int64), np.empty(SYMBOLS, dtype=np.int64)
    symbol_codes = np.empty(SYMBOLS, dtype=np.uint64)
    words, bits = np.zeros(TOKENS, dtype=np.uint64), np.zeros(TOKENS, dtype=np.uint64)
    at, checksum = 0, 1
    for start in range(0, data.size, BLOCK):
        stop = min(start + BLOCK, data.size)
        checksum = adler32(data[start:stop], checksum)
        found = find_matches(data, (start, stop), distance, masks, threes, places)
        number = _tokens(data, start, stop, places[:found], tokens)
        _count(tokens[:number], tallies, counts)
        code_lengths(counts, CODE_BITS, lengths)
        codes(lengths, symbol_codes)
        at = _put(out, at, (2 << 1) | int(stop == data.size), 3)
        at = _put_lengths(out, at, lengths, _distance(distance).code)
        _stream_words(lengths, symbol_codes, _distance(distance), words, bits)
        at = _put_tokens(out, at, tokens[:number], words, bits)
        at = _put(out, at, words[END], np.int64(bits[END]))
    return Deflated(at, checksum)


@compiled("u1 i0 i0 i1 h1!", inner=True, allocates=False)
def _tokens(data: Any, start: int, stop: int, places: Any, tokens: Any) -> int:
    """Tokenize data[start:stop] with the places of its matches, as of `find_matches`; returns the number of tokens."""
    number, i, matches = 0, start, places.size // 2
    apart = matches
    while apart > 0 and start + places[2 * apart - 2] + COPIED > data.size:
        apart -= 1
    for k in range(matches):
        begin, end = start + places[2 * k], start + places[2 * k + 1]
        if k < apart:
            copy_bytes(data, np.uint64(i), tokens, np.uint64(number))
            if begin - i > COPIED:
                _copy(data, i + COPIED, begin, tokens, number + COPIED)
        else:
            _copy(data, i, begin, tokens, number)
        number += begin - i
        i = begin
        while end - i > LONGEST:
            tokens[number] = END + LONGEST
            number += 1
            i += LONGEST
        if end - i >= SHORTEST:
            tokens[number] = END + end - i
            number += 1
            i = end
    _copy(data, i, stop, tokens, number)
    return number + stop - i


@compiled
def _copy(data: Any, start: int, stop: int, tokens: Any, number: int) -> None:
    """Literals as tokens."""
    at, into = np.uint64(start), np.uint64(number)
    for k in range(np.uint64(max(stop - start, 0))):
        tokens[into + k] = data[at + k]


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
        counts[SYMBOL_OF[token]] += tallies[0, token] + tallies[1, token] + tallies[2, token] + tallies[3, token]
    counts[END] = 1


class Distance(NamedTuple):
    """Code of a distance, and its extra bits (section 3.2.5)."""

    code: int
    extra: int
    rest: int


@compiled
def _distance(distance: int) -> Distance:
    """How a distance up to MOST_DISTANT is written."""
    if distance <= 4:
        return Distance(distance - 1, 0, 0)
    return Distance(4 + (distance - 5) // 2, 1, (distance - 5) % 2)


@compiled
def _stream_words(lengths: Any, symbol_codes: Any, distance: Any, words: Any, bits: Any) -> None:
    """Bit pattern and length of each token: for a match its code, its extra bits, and a 0 and those of the distance."""
    words[: END + 1], bits[: END + 1] = symbol_codes[: END + 1], lengths[: END + 1]
    for length in range(SHORTEST, LONGEST + 1):
        symbol, extra = SYMBOL_OF[END + length], EXTRA[length]
        rest = ((length - SHORTEST) & ((1 << extra) - 1)) | (distance.rest << (extra + 1))
        words[END + length] = symbol_codes[symbol] | (np.uint64(rest) << np.uint64(lengths[symbol]))
        bits[END + length] = lengths[symbol] + extra + 1 + distance.extra


@compiled
def _put_lengths(out: Any, at: int, lengths: Any, distance_code: int) -> Any:
    """Write the lengths of all codes, with one distance code of one bit (section 3.2.7); returns the next bit."""
    at = _put(out, at, SYMBOLS - 257, 5)
    at = _put(out, at, distance_code, 5)
    at = _put(out, at, META_ORDER.size - 4, 4)
    counts, meta = np.zeros(META_ORDER.size, dtype=np.int64), np.zeros(META_ORDER.size, dtype=np.int64)
    counts[0], counts[1] = distance_code, 1
    for length in lengths:
        counts[length] += 1
    code_lengths(counts, META_BITS, meta)
    meta_codes = np.empty(META_ORDER.size, dtype=np.uint64)
    codes(meta, meta_codes)
    for symbol in META_ORDER:
        at = _put(out, at, meta[symbol], 3)
    for length in lengths:
        at = _put(out, at, meta_codes[length], meta[length])
    for _ in range(distance_code):
        at = _put(out, at, meta_codes[0], meta[0])
    return _put(out, at, meta_codes[1], meta[1])


@compiled
def _put(out: Any, at: int, word: int, count: Any) -> Any:
    """Write the lowest `count` bits of a word, whose other bits are 0, at bit `at`; returns the next bit."""
    k, shift = at >> 6, at & 63
    if shift == 0:
        out[k] = np.uint64(word)
    else:
        out[k] |= np.uint64(word) << np.uint64(shift)
        if shift + count > 64:
            out[k + 1] = np.uint64(word) >> np.uint64(64 - shift)
    return at + count


@compiled("w1! i0 h1 w1 w1", inner=True, allocates=False)
def _put_tokens(out: Any, at: Any, tokens: Any, words: Any, bits: Any) -> Any:
    """Write the bit patterns of all tokens, as `_put` with the current output word buffered; returns the next bit.

    Eight at once where they have fewer bits than a word, as most have, else one by one.
    """
    k, fill = np.uint64(at >> 6), np.uint64(at & 63)
    buffer = out[k] if fill else np.uint64(0)
    whole, four, eight = tokens.size - tokens.size % 8, np.uint64(4), np.uint64(8)
    for i in range(np.uint64(0), np.uint64(whole), eight):
        word, count = _four(tokens, i, words, bits)
        further, more = _four(tokens, i + four, words, bits)
        if count + more < np.uint64(BITS):
            k, fill, buffer = _append(out, k, fill, buffer, word | (further << count), count + more)
        else:
            for j in range(i, i + eight):
                k, fill, buffer = _append(out, k, fill, buffer, words[tokens[j]], bits[tokens[j]])
    if fill:
        out[k] = buffer
    at = np.int64(np.uint64(64) * k + fill)
    for i in range(whole, tokens.size):
        at = _put(out, at, words[tokens[i]], np.int64(bits[tokens[i]]))
    return at


@compiled
def _four(tokens: Any, i: Any, words: Any, bits: Any) -> tuple[Any, Any]:
    """The bit pattern of four tokens, if they have fewer bits than a word, and how many they have."""
    a, b, c, d = tokens[i], tokens[i + np.uint64(1)], tokens[i + np.uint64(2)], tokens[i + np.uint64(3)]
    one, two = bits[a], bits[a] + bits[b]
    three = two + bits[c]
    return words[a] | (words[b] << one) | (words[c] << two) | (words[d] << three), three + bits[d]


@compiled
def _append(out: Any, k: Any, fill: Any, buffer: Any, word: Any, count: Any) -> tuple[Any, Any, Any]:
    """Append fewer than 64 bits to output word k, of which so many are filled; returns the same three of what follows.

    Without a branch for a full word, which would often be mispredicted.
    """
    out[k] = buffer | (word << fill)
    after = (word >> np.uint64(1)) >> (np.uint64(63) - fill)
    fill += count
    full = fill >> np.uint64(6)
    return k + full, fill & np.uint64(63), after if full else out[k]
