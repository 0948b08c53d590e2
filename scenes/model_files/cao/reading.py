"""Reader of CAO models, the format of ViSP's model-based tracker: points, faces of points or lines, cylinders, circles.

The writer is `cao_writing`.
"""

import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uavbench.scenes.model_files.cao.cylinders import cylinder, disc, is_end
from uavbench.scenes.model_files.face_limits import FaceWork, check_count
from uavbench.scenes.model_files.mesh_piece import Loaded
from uavbench.scenes.primitives.solids import polygon_triangles
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import LARGEST_COORDINATE_M, LONGEST_LINE, MODEL, MOST_NESTING, MOST_ROWS
from uavbench.trajectories.files.reading import read_text
from uavbench.trajectories.files.tables import plain_number
from uavbench.trajectories.pose import Pose, rotation_exp

MOST_LOADS = 1000
"""Most pieces of one model, each counted once per load; the largest of ViSP's own models have 20."""
MOST_LINES = 2 * MOST_ROWS
"""Most lines of one file: points and faces of a model of MOST_TRIANGLES."""
MOST_ROUND = 10_000
"""Most cylinders, and most circles, of one file: 1.7 million triangles."""
MOST_CORNERS = 1000
"""Most corners of one face; ear clipping is at least quadratic in their number."""
LOAD = re.compile(r"""load\(\s*["']([^"']+)["']\s*((?:,\s*\w+\s*=\s*\[[^\]]*\]\s*)*)\)""", re.IGNORECASE)
PARAMETER = re.compile(r"(\w+)\s*=\s*\[([^\]]*)\]")
OPTION = re.compile(r"""\w+=(?:"[^"]*"|\S*)""")
"""An option of a row, as `minLineLengthThreshold=50` or a name, which may have spaces within quotation marks (ViSP)."""
UNITS = {"": 1.0, "rad": 1.0, "deg": math.pi / 180}
"""Radians per unit of an angle."""
SIZES = {"t": 3, "tu": 3, "R": 9}
"""Components of each parameter of a load: translation, theta-u vector, row-major rotation matrix (ViSP 3.7)."""


@dataclass(frozen=True)
class Piece:
    """Numbered rows of one file of a model, without its loads, and the pose composed of the loads above it."""

    path: Path
    rows: list[tuple[int, str]]
    model_from_piece: Pose


def read_cao(path: Path) -> Loaded:
    """Triangle mesh of a CAO model, loaded files included; UserError naming file and line when it is invalid.

    A load may have a pose: `load("part.cao", t=[x; y; z], tu=[a; b; c])`, with t in metres and tu (axis times angle) in
    radians, or in degrees with the suffix `deg`. A point p maps to exp(tu) p + t; nested loads are composed. Cylinders
    and circles are tessellated (`cylinders`); a circle that coincides with an end of a cylinder is skipped, since
    cylinders are closed.
    """
    placed: list[Loaded] = []
    work = FaceWork(path)
    for piece in _files(path):
        placed.append(_placed(_piece(piece, work), piece.model_from_piece))
        check_count(path, sum(len(each.triangles) for each in placed))
    return _joined(placed, path.stem)


def _files(path: Path, above: tuple[Path, ...] = (), model_from_file: Pose | None = None) -> list[Piece]:
    """All files of a model with their rows and poses, each after the files that it loads."""
    above, model_from_file = (*above, path.resolve()), model_from_file or Pose.identity()
    out, own = [], []
    for number, row in _rows(path):
        if not row.lower().startswith("load"):
            own.append((number, row))
            continue
        found = LOAD.fullmatch(row)
        if not found:
            raise UserError(
                f'{path}: line {number}: expected load("FILE"), or load("FILE", t=[x; y; z], tu=[a; b; c]), got {row!r}'
            )
        try:
            file_from_loaded = _placement(found[2])
        except ValueError as error:
            raise UserError(f"{path}: line {number}: {error}") from None
        file = path.parent / found[1]
        if not _beside(file, above):
            raise UserError(f"{path}: line {number}: {found[1]} loads itself, or is outside the model's folder")
        out += _files(file, above, model_from_file @ file_from_loaded)
        _check_loads(path, number, len(above), out)
    return [*out, Piece(path, own, model_from_file)]


def _placement(text: str) -> Pose:
    """Pose `file_from_loaded` from the parameters of a load; ValueError when they are invalid."""
    given: dict[str, list[float]] = {}
    for name, values in PARAMETER.findall(text):
        if name not in SIZES:
            raise ValueError(f"unknown parameter {name!r} of load (valid: {', '.join(SIZES)})")
        if name in given:
            raise ValueError(f"{name} is given twice")
        words = re.split(r"[;,]", values)
        given[name] = [_angle(word) if name == "tu" else _number(word) for word in words]
        if len(words) != SIZES[name]:
            raise ValueError(f"{name}=[{values}] has {len(words)} numbers, expected {SIZES[name]} with ; between them")
    if "tu" in given and "R" in given:
        raise ValueError("a load takes tu or R, not both")
    R = np.array(given["R"]).reshape(3, 3) if "R" in given else rotation_exp(np.array(given.get("tu", [0.0] * 3)))
    if not (np.abs(R @ R.T - np.eye(3)).max() < 1e-4 and np.linalg.det(R) > 0):
        raise ValueError("R is not a rotation (1e-4)")
    return Pose(R, np.array(given.get("t", [0.0] * 3)))


def _angle(word: str) -> float:
    """Angle in radians from text such as `90 deg`, `1.57 rad` or `1.57`."""
    found = re.fullmatch(r"(.*?)\s*(deg|rad|)", word.strip())
    assert found
    return _number(found[1]) * UNITS[found[2]]


def _number(word: str) -> float:
    value = plain_number(word)
    if not abs(value) <= LARGEST_COORDINATE_M:
        raise ValueError(f"{word.strip()} is not finite, or beyond {LARGEST_COORDINATE_M:g}")
    return value


def _placed(piece: Loaded, model_from_piece: Pose) -> Loaded:
    return piece.moved(model_from_piece.rotation, model_from_piece.translation)


def _beside(file: Path, above: tuple[Path, ...]) -> bool:
    """Whether a file lies in the model's folder and is not among the files that load it (no cycle)."""
    try:
        place = file.resolve()
    except (OSError, ValueError, RuntimeError):  # a null character in the name, a cycle of links
        return False
    return place not in above and place.is_relative_to(above[0].parent)


def _check_loads(path: Path, number: int, depth: int, loaded: list[Piece]) -> None:
    """UserError when nested loads make a model too large: two loads in each of 21 files make two million pieces."""
    rows = sum(len(piece.rows) for piece in loaded)
    if depth > MOST_NESTING or len(loaded) > MOST_LOADS or rows > MOST_ROWS:
        raise UserError(
            f"{path}: line {number}: its loads make a model of more than {MOST_LOADS:,} pieces, {MOST_ROWS:,} rows or "
            f"{MOST_NESTING} levels; load each part once"
        )


def _piece(piece: Piece, work: FaceWork) -> Loaded:
    """Triangle mesh of the rows of one file, in its own frame."""
    path, rows = piece.path, iter(piece.rows)

    def numbers(what: str) -> tuple[int, list[str]]:
        number, row = next(rows, (0, ""))
        if not row:
            raise UserError(f"{path}: ends before its {what}; a CAO model has points, lines, faces, cylinders, circles")
        try:
            return number, _values(row)
        except ValueError:
            raise UserError(f"{path}: line {number}: expected numbers for the {what}, got {row!r}") from None

    def block(what: str, count: int | None = None) -> list[list[str]]:
        if count is None:
            line, values = numbers(what)
            count = _count(path, line, what, values)
        return [numbers(what)[1] for _ in range(count)]

    def indices(what: str, rows: list[list[str]]) -> list[list[int]]:
        try:
            return [list(map(_whole, row)) for row in rows]
        except ValueError as error:
            raise UserError(f"{path}: the {what} take whole numbers: {error}") from None

    def polygons(what: str) -> list[list[int]]:
        table = indices(what, block(what))
        for size, *corners in (row or [0] for row in table):
            if not 3 <= size <= min(len(corners), MOST_CORNERS):
                raise UserError(
                    f"{path}: the {what}: one of {size} corners has {len(corners)}; it takes 3 to {MOST_CORNERS}"
                )
        return [row[1 : 1 + row[0]] for row in table]

    number, first = next(rows, (0, ""))
    if first.upper() != "V1":
        raise UserError(f"{path}: line {number}: a CAO model begins with V1, got {first!r}")
    if len(piece.rows) == 1:  # it only loads others
        return Loaded(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    table = [[float(v) for v in row[:3]] for row in block("points")]
    if any(len(row) != 3 for row in table):
        raise UserError(f"{path}: a point has three coordinates, one of these has fewer")
    points = np.array(table).reshape(-1, 3)
    lines = indices("lines", [row[:2] for row in block("lines")])
    from_lines = polygons("faces of lines")
    from_points = polygons("faces of points")
    cylinders = block("cylinders", _count_if_any(path, rows, "cylinders"))
    circles = block("circles", _count_if_any(path, rows, "circles"))
    try:
        if min((k for face in (*lines, *from_lines, *from_points) for k in face), default=0) < 0:
            raise ValueError("a number below 0")
        faces = [*[_chained([lines[k] for k in face]) for face in from_lines], *from_points]
        work.add(map(len, faces))
        triangles = [np.array(face)[polygon_triangles(points[face])] for face in faces]
    except (IndexError, ValueError) as error:
        raise UserError(f"{path}: a face is not a simple polygon of existing points or lines: {error}") from None
    flat = Loaded(points, np.concatenate(triangles) if triangles else np.zeros((0, 3), dtype=np.int64))
    try:
        ends = [(points[_index(a)], points[_index(b)], float(radius)) for a, b, radius in cylinders]
        discs = [(float(r), points[_index(a)], points[_index(b)], points[_index(c)]) for r, a, b, c in circles]
        round_ = [cylinder(*row) for row in ends]
        starts, stops, radii = (np.array([end[k] for end in ends]) for k in range(3))
        round_ += [disc(*row) for row in discs if not (ends and is_end(row[1], row[0], starts, stops, radii).any())]
    except (IndexError, ValueError, TypeError) as error:
        raise UserError(
            f"{path}: a cylinder takes two existing points and a radius, a circle a radius and three points: {error}"
        ) from None
    return _joined([flat, *round_], path.stem)


def _joined(pieces: list[Loaded], name: str) -> Loaded:
    """Concatenation of pieces."""
    shift = np.cumsum([0, *(len(piece.vertices) for piece in pieces[:-1])])
    return Loaded(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([piece.triangles + n for piece, n in zip(pieces, shift, strict=True)]),
        name=name,
    )


def _rows(path: Path) -> Iterator[tuple[int, str]]:
    """Numbered lines of a file, without comments and blank lines."""
    text = read_text(path, MODEL)
    if text.count("\n") + text.count("\r") > 2 * MOST_LINES:  # a line may end with both
        raise UserError(f"{path}: more than {MOST_LINES:,} lines; simplify the model to its planar faces")
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        if number > MOST_LINES or len(line) > LONGEST_LINE:
            raise UserError(
                f"{path}: line {number}: beyond {MOST_LINES:,} lines, or longer than {LONGEST_LINE:,} characters"
            )
        bare = line.split("#")[0].split("//")[0].strip()
        if bare:
            yield number, bare


def _values(row: str) -> list[str]:
    """Numbers of a row, without ViSP's trailing options (name=..., minLineLengthThreshold=...)."""
    values = (OPTION.sub(" ", row) if "=" in row else row).split()
    if not all(abs(plain_number(word)) <= LARGEST_COORDINATE_M for word in values):
        raise ValueError(f"a number is not finite, or beyond {LARGEST_COORDINATE_M:g}")
    return values


def _whole(word: str) -> int:
    """Integer from text, where ViSP also accepts `4.0`; ValueError when it is not an integer."""
    value = float(word)
    if not value.is_integer():
        raise ValueError(f"{word} is not a whole number")
    return int(value)


def _index(word: str) -> int:
    """Integer from 0 on from text; ValueError when it is none."""
    if (index := _whole(word)) < 0:
        raise ValueError(f"{word} is below 0")
    return index


def _count(path: Path, number: int, what: str, values: list[str], most: int = MOST_ROWS) -> int:
    """Number of rows in a block; UserError when it is not an integer within 0 .. most."""
    try:
        count = _whole(values[0])
        if not 0 <= count <= most:
            raise ValueError(f"{count:,} is not within 0 .. {most:,}")
    except (ValueError, IndexError, OverflowError) as error:
        raise UserError(f"{path}: line {number}: the number of {what} must be a whole number: {error}") from None
    return count


def _count_if_any(path: Path, rows: Iterator[tuple[int, str]], what: str) -> int:
    number, row = next(rows, (0, "0"))
    return _count(path, number, what, row.split(), MOST_ROUND)


def _chained(pieces: list[list[int]]) -> list[int]:
    """Vertices of a polygon from its sides in order, each in either direction; ValueError when they do not connect."""
    a, b = pieces[0]
    out = [b, a] if a in pieces[1] else [a, b]
    for piece in pieces[1:-1]:
        if out[-1] not in piece:
            raise ValueError("its lines are not connected")
        out.append(piece[0] if piece[1] == out[-1] else piece[1])
    if {*pieces[-1]} != {out[-1], out[0]}:
        raise ValueError("its lines are not connected")
    return out
