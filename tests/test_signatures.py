"""Signatures that can be read: few parameters, and results with names."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LAYERS = ("bench", "reports", "tracker", "scenes", "trajectories")
MOST_PARAMETERS = 7
ACCEPTED = {
    "bench/gate/worst_pictures.py Run.rank": "a key to sort by, which nobody takes apart",
    "bench/learning/environment.py InspectionEnv.reset": "the interface of Gymnasium",
    "bench/learning/environment.py InspectionEnv.step": "the interface of Gymnasium",
}
"""Public functions with a tuple whose places differ in type and have no names, and why."""
LONGEST_TRACK = 60
"""Lines of the function that a newcomer to `robust` reads first."""


def functions(folder: Path) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Every function of the modules in a folder, with the place where it stands."""
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                yield f"{path.relative_to(ROOT)}:{node.lineno} {node.name}", node


def parameters(function: ast.FunctionDef) -> list[str]:
    """Names of a function's parameters, without that of the object or class itself."""
    given = function.args
    names = [argument.arg for argument in given.posonlyargs + given.args + given.kwonlyargs]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


def public_functions(layer: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Functions and methods of a layer that other modules may call, by file and name; none that stand in a function."""
    for path in sorted((ROOT / layer).rglob("*.py")):
        place = path.relative_to(ROOT)
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                yield from ((f"{place} {node.name}.{f.name}", f) for f in node.body if isinstance(f, ast.FunctionDef))
            elif isinstance(node, ast.FunctionDef):
                yield f"{place} {node.name}", node


def annotations(function: ast.FunctionDef) -> list[ast.expr]:
    """Types of a function's parameters and of its result."""
    given = function.args
    arguments = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    return [a for a in (*(each.annotation for each in arguments if each), function.returns) if a is not None]


def is_command(function: ast.FunctionDef) -> bool:
    """Whether each parameter is an option of a command, which click calls by name."""
    return any("command(" in ast.unparse(decorator) for decorator in function.decorator_list)


def is_unnamed(annotation: ast.expr | None) -> bool:
    """Whether a result is, or holds, a tuple of several values without names."""
    held = [node for node in ast.walk(annotation) if isinstance(node, ast.Subscript)] if annotation else []
    tuples = [
        node.slice.elts for node in held if ast.unparse(node.value) == "tuple" and isinstance(node.slice, ast.Tuple)
    ]
    return any(ast.unparse(values[-1]) != "..." for values in tuples)


def mixes_types(annotation: ast.expr) -> bool:
    """Whether a type is, or holds, a tuple of places of different types without names, such as tuple[int, str]."""
    for node in ast.walk(annotation):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and mixes_types(quoted(node.value)):
            return True
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "tuple" and isinstance(node.slice, ast.Tuple):
            places = [ast.unparse(place) for place in node.slice.elts]
            if places[-1] != "..." and len(set(places)) > 1:
                return True
    return False


def quoted(text: str) -> ast.expr:
    """The type that is written in quotation marks; one that holds nothing where the text is none, as in a Literal."""
    try:
        return ast.parse(text, mode="eval").body
    except SyntaxError:
        return ast.Constant(None)


@pytest.mark.parametrize("layer", LAYERS)
def test_no_public_signature_has_a_tuple_of_mixed_types_without_names(layer: str) -> None:
    found = {
        at for at, f in public_functions(layer) if not f.name.startswith("_") and any(map(mixes_types, annotations(f)))
    }
    assert found == {at for at in ACCEPTED if at.startswith(f"{layer}/")}


def test_a_tuple_of_mixed_types_is_seen() -> None:
    def said(text: str) -> bool:
        (function,) = ast.parse(f"def f({text}: ...").body
        assert isinstance(function, ast.FunctionDef)
        return any(map(mixes_types, annotations(function)))

    assert said("a: list[tuple[int, str]])")
    assert said("*a: tuple[int, str])")
    assert said('a: "Iterator[tuple[int, str]] | None")')
    assert said(") -> tuple[tuple[int, ...], str]")
    assert not said("a: tuple[float, float], b: tuple[str, ...]) -> Size")
    assert not said('a: Literal["no type", "1 +"])')


@pytest.mark.parametrize("layer", LAYERS)
def test_no_function_has_more_than_seven_parameters(layer: str) -> None:
    found = functions(ROOT / layer)
    assert [at for at, f in found if len(parameters(f)) > MOST_PARAMETERS and not is_command(f)] == []


def test_no_result_of_a_tracker_is_an_unnamed_tuple() -> None:
    rooms = ("robust", "shang_shen", "fusion", "images")
    assert [at for room in rooms for at, f in functions(ROOT / "tracker" / room) if is_unnamed(f.returns)] == []
    kernels = ROOT / "tracker" / "geometry_kernels.py"
    returned = [node.returns for node in ast.parse(kernels.read_text()).body if isinstance(node, ast.FunctionDef)]
    assert returned
    assert not any(map(is_unnamed, returned))


def test_a_tuple_without_names_is_seen() -> None:
    assert is_unnamed(ast.parse("def f() -> Iterator[tuple[int, str]]: ...").body[0].returns)  # type: ignore[attr-defined]
    assert not is_unnamed(ast.parse("def f() -> tuple[int, ...]: ...").body[0].returns)  # type: ignore[attr-defined]


def test_track_of_robust_fits_on_a_page() -> None:
    (track,) = [f for _, f in functions(ROOT / "tracker" / "robust") if f.name == "track"]
    assert track.end_lineno is not None
    assert track.end_lineno - track.lineno < LONGEST_TRACK
