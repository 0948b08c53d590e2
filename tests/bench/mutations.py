"""Valid files with something wrong in them: what a fuzz test feeds to a reader.

A mutation knows the structure: it takes a word, a line or a value of a valid file and puts another in its place, so
that most of the file is still read. A few bytes anywhere are the other way to be wrong.
"""

import copy
import json
import re

from hypothesis import strategies as st

WORDS = [
    "", "0", "1", "-1", "2", "3.5", "1e3", "1e308", "1e999", "-1e999999", "nan", "inf", "-inf", "9" * 30, "9" * 400,
    "0x10", "1_0", "x", "true", '"x"', "[", "]", "{", "}", "#", ",", ";", "= =", "\x00", "\ufeff", "../x",
    "/dev/zero", "\u0664",
]  # fmt: skip
VALUES = [None, True, 0, -1, 3.5, 1e308, 10**30, 10**400, "", "x", "../x", [], [[]], {}, {"a": 1}, [1, "x"], [[[[1]]]]]


def damaged_text(valid: str) -> st.SearchStrategy[bytes]:
    """Bytes of a valid text file with one to three words or lines replaced, doubled, swapped or left out, or noise."""
    words = re.split(r"(\s+|,)", valid)
    place = st.integers(0, len(words) - 1)
    change = st.tuples(place, st.sampled_from(WORDS) | st.integers().map(str) | place.map(lambda k: words[k]))
    lines = valid.splitlines(keepends=True)
    row = st.integers(0, len(lines) - 1)
    return st.one_of(
        st.lists(change, min_size=1, max_size=3).map(lambda changes: _replaced(words, changes)),
        st.tuples(row, row).map(lambda t: "".join([*lines[: t[0]], lines[t[1]], *lines[t[0] :]])),
        st.tuples(row, row).map(lambda t: "".join([*lines[: min(t)], *lines[max(t) :]])),
        st.tuples(row, row).map(lambda t: _swapped(lines, *t)),
    ).map(lambda text: text.encode()) | damaged_bytes(valid.encode())


def damaged_bytes(valid: bytes) -> st.SearchStrategy[bytes]:
    """A valid file with a few bytes replaced, cut off at its end, or noise alone."""
    place = st.integers(0, len(valid))
    small = st.tuples(place, st.integers(0, 3), st.binary(max_size=6))
    return st.one_of(
        st.binary(max_size=200),
        place.map(lambda end: valid[:end]),
        small.map(lambda t: valid[: t[0]] + t[2] + valid[t[0] + t[1] :]),
    )


def damaged_json(valid: str) -> st.SearchStrategy[bytes]:
    """Bytes of valid JSON with one to three of its values replaced by one of another type, or damaged as text is."""
    value = json.loads(valid)
    paths = [*_paths(value)]
    changes = st.lists(st.tuples(st.sampled_from(paths), st.sampled_from(VALUES)), min_size=1, max_size=3)
    return changes.map(lambda t: _with(value, t).encode()) | damaged_text(valid)


def _replaced(words: list[str], changes: list[tuple[int, str]]) -> str:
    new = dict(changes)
    return "".join(new.get(k, word) for k, word in enumerate(words))


def _swapped(lines: list[str], a: int, b: int) -> str:
    lines = lines.copy()
    lines[a], lines[b] = lines[b], lines[a]
    return "".join(lines)


def _paths(value, at=()):
    yield at
    for key in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield from _paths(value[key], (*at, key))


def _with(value, changes) -> str:
    value = copy.deepcopy(value)
    for path, given in changes:
        new = copy.deepcopy(given)  # a later change may be within it
        if not path:
            value = new
            continue
        parent = value
        try:
            for key in path[:-1]:
                parent = parent[key]
            parent[path[-1]] = new
        except (TypeError, KeyError, IndexError):  # an earlier change took it away
            continue
    return json.dumps(value)
