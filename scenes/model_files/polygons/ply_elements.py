"""A PLY file in the forms that its reader knows: text without empty lines, or binary lists that are equally long."""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.trajectories.errors import UserError

TYPES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
         "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f",
         "float64": "d"}  # fmt: skip
"""Type of a PLY file -> its letter in struct and NumPy."""
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
FORMAT = re.compile(rb"^format[ \t]+(\w+)", re.MULTILINE)
END = re.compile(rb"^end_header[ \t]*(?:\r\n|\n)", re.MULTILINE)


@dataclass
class Element:
    """An element of a header: its name, how many rows it has, and the words of each property."""

    name: str
    count: int
    properties: list[list[str]] = field(default_factory=list)


def with_plain_elements(path: Path, data: bytes) -> bytes:
    """A PLY file's content; as text without empty lines and comments if it has them or lists of different lengths.

    UserError for a file that ends before the rows that its header counts. What has no header is left to its reader.
    """
    end, form = END.search(data), FORMAT.search(data)
    if end is None or form is None:
        return data
    elements = [element for element in _elements(data[: end.end()]) if element.count and element.properties]
    order = ORDERS.get(form[1].decode())
    if order is None:
        return data[: end.end()] + _plain_text(path, data[end.end() :], elements)
    if not all(word in TYPES for element in elements for words in element.properties for word in _types(words)):
        return data
    body = data[end.end() :]
    if _alike(elements, order, body):
        return data
    text = b"\n".join(_as_text(path, elements, order, body)) + b"\n"
    return FORMAT.sub(b"format ascii", data[: end.end()], count=1) + text


def _elements(head: bytes) -> list[Element]:
    found: list[Element] = []
    for words in map(str.split, head.decode("latin-1").splitlines()):
        if len(words) == 3 and words[0] == "element" and words[2].isdigit():
            found.append(Element(words[1], int(words[2])))
        elif len(words) > 2 and words[0] == "property" and found:
            found[-1].properties.append(words[1:])
    return found


def _types(words: list[str]) -> list[str]:
    """Types of a property: that of its value, or of a list those of its length and its values."""
    return words[1:3] if words[0] == "list" else words[:1]


def _plain_text(path: Path, body: bytes, elements: list[Element]) -> bytes:
    lines = [line for line in body.splitlines() if line.strip() and not line.startswith(b"comment")]
    left = len(lines)
    for element in elements:
        if element.count > left:
            raise UserError(_cut_short(path, element, left))
        left -= element.count
    return b"\n".join(lines) + b"\n"


def _cut_short(path: Path, element: Element, held: int) -> str:
    return (
        f"{path}: is truncated: its header counts {element.count:,} rows of {element.name}, and it holds {held:,}; "
        "copy it again, or export the model again"
    )


def _alike(elements: list[Element], order: str, body: bytes) -> bool:
    """Whether the lists of each property are equally long, so that all rows of an element have one size."""
    at = 0
    try:
        for element in elements:
            kinds, lengths, first = list[tuple[Any, ...]](), dict[str, int](), at
            for number, words in enumerate(element.properties):
                kind, *of = (order + TYPES[word] for word in _types(words))
                kinds.append((str(number), kind))
                if of:
                    (lengths[str(number)],) = struct.unpack_from(kind, body, first)
                    kinds.append((f"values of {number}", of[0], (lengths[str(number)],)))
                first = at + np.dtype(kinds).itemsize
            rows = np.frombuffer(body, np.dtype(kinds), element.count, at)
            if any((rows[name] != length).any() for name, length in lengths.items()):
                return False
            at += rows.nbytes
    except (struct.error, ValueError):  # too short, if all rows were as the first one
        return False
    return True


def _as_text(path: Path, elements: list[Element], order: str, body: bytes) -> Iterator[bytes]:
    """A line for each row; UserError where the file ends before the last one."""
    at = 0
    for element in elements:
        kinds = [[order + TYPES[word] for word in _types(words)] for words in element.properties]
        for held in range(element.count):
            row: list[float] = []
            try:
                for kind, *of in kinds:
                    row += struct.unpack_from(kind, body, at)
                    at += struct.calcsize(kind)
                    if of:
                        values = f"{order}{int(row[-1])}{of[0][-1]}"
                        row += struct.unpack_from(values, body, at)
                        at += struct.calcsize(values)
            except struct.error:
                raise UserError(_cut_short(path, element, held)) from None
            yield " ".join(map(repr, row)).encode()
