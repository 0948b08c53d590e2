"""Compact notation for the argument types of kernels.

One word for each argument: its element (f float64, s float32, i int64, j int32, u uint8, h uint16, w uint64, b bool)
and its number of dimensions, 0 for a scalar. An array is contiguous and only read; `!` after it means that it is
written in place, `~` that it may be strided. A tuple of arguments is in parentheses, a named tuple is a word of its
own, and `|` separates forms that a kernel is compiled for: ``"f2! i1 f0 (f1 f2)"``.
"""

import re
from collections.abc import Mapping
from typing import Any

import numba

types: Any = numba.types
ELEMENTS = {
    "f": types.float64,
    "s": types.float32,
    "i": types.int64,
    "j": types.int32,
    "u": types.uint8,
    "h": types.uint16,
    "w": types.uint64,
    "b": types.boolean,
}
WORD = re.compile(r"(?P<element>[fsijuhwb])(?P<dimensions>\d)(?P<marks>[!~]*)")


def argument_types(text: str, tuples: Mapping[str, Any]) -> tuple[tuple[Any, ...], ...]:
    """Numba's types of each form of arguments in a text; ValueError for an invalid word.

    tuples: the named tuples among them, as returned by `named_tuple`.
    """
    return tuple(_form(form, tuples) for form in text.split("|"))


def named_tuple(cls: type, text: str, **tuples: Any) -> Any:
    """Numba's type of a named tuple, from the types of its fields, with the named tuples among them."""
    ((*fields,),) = argument_types(text, tuples)
    return types.BaseTuple.from_types(fields, cls)


def _form(text: str, tuples: Mapping[str, Any]) -> tuple[Any, ...]:
    levels: list[list[Any]] = [[]]
    for word in text.replace("(", " ( ").replace(")", " ) ").split():
        if word == "(":
            levels.append([])
        elif word == ")":
            members = levels.pop()
            levels[-1].append(types.Tuple(members))
        else:
            levels[-1].append(tuples[word] if word in tuples else _argument(word))
    (found,) = levels
    return tuple(found)


def _argument(word: str) -> Any:
    found = WORD.fullmatch(word)
    if found is None:
        raise ValueError(f"{word!r} is not the type of an argument")
    element, dimensions, marks = ELEMENTS[found["element"]], int(found["dimensions"]), found["marks"]
    if dimensions == 0:
        return element
    return types.Array(element, dimensions, "A" if "~" in marks else "C", readonly="!" not in marks)
