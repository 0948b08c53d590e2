"""Colours of PLY files: as their programs mean them, or told."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import trimesh

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.trajectories.errors import UserError

RGB = ("red", "green", "blue")
LETTERS = {"uchar": "u1", "ushort": "u2", "int": "i4", "float": "f4", "double": "f8"}
LINEAR = (np.array([200.0, 40.0, 10.0]) / 255) ** 2.2


def ply(path: Path, names: Sequence[str], kind: str, rgb: Sequence[float], *, on: str = "vertex", text: bool) -> Path:
    """A box of one colour on its vertices or faces."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    colour = [f"property {kind} {name}" for name in names]
    head = [f"element vertex {len(box.vertices)}", *(f"property float {axis}" for axis in "xyz")]
    head += (colour if on == "vertex" else []) + [f"element face {len(box.faces)}"]
    head += ["property list uchar int vertex_indices", *(colour if on == "face" else []), "end_header"]
    form = "ascii" if text else "binary_little_endian"
    path.write_bytes("\n".join(["ply", f"format {form} 1.0", *head, ""]).encode())
    colours = {"vertex": [], "face": [], on: list(rgb)}
    with path.open("ab") as handle:
        for element, row in [*(("vertex", v) for v in box.vertices), *(("face", f) for f in box.faces)]:
            if text:
                words = [*([3] if element == "face" else []), *row, *colours[element]]
                handle.write((" ".join(map(str, words)) + "\n").encode())
                continue
            handle.write(np.uint8(3).tobytes() if element == "face" else b"")
            handle.write(np.asarray(row, "<f4" if element == "vertex" else "<i4").tobytes())
            handle.write(np.array(colours[element], "<" + LETTERS[kind]).tobytes())
    return path


def tint(path: Path) -> np.ndarray:
    (part,) = MeshFile(path=str(path)).build(np.random.default_rng(0)).parts
    assert part.tint is not None
    return np.unique(part.tint[:, :3], axis=0).squeeze()


@pytest.mark.parametrize("text", [True, False], ids=["text", "binary"])
@pytest.mark.parametrize("on", ["vertex", "face"])
@pytest.mark.parametrize(
    ("kind", "rgb"),
    [("uchar", (200, 40, 10)), ("int", (200, 40, 10)), ("float", (200 / 255, 40 / 255, 10 / 255))],
)
def test_colours_of_bytes_and_parts_of_one_are_read(
    tmp_path: Path, kind: str, rgb: Sequence[float], on: str, text: bool
) -> None:
    np.testing.assert_allclose(tint(ply(tmp_path / "a.ply", RGB, kind, rgb, on=on, text=text)), LINEAR, rtol=0.05)


@pytest.mark.parametrize("text", [True, False], ids=["text", "binary"])
@pytest.mark.parametrize("on", ["vertex", "face"])
@pytest.mark.parametrize(
    ("names", "kind", "rgb", "told"),
    [
        (RGB, "float", (200.0, 40.0, 10.0), r"are floats beyond 0 to 1 \(10 to 200\); export them as uchar"),
        (RGB, "double", (255.0, 0.0, 0.0), r"are floats beyond 0 to 1 \(0 to 255\)"),
        (RGB, "float", (-1.0, 0.0, 0.0), "are floats beyond 0 to 1"),
        (RGB, "float", (float("nan"), 0.0, 0.0), "are not all finite numbers"),
        (RGB, "ushort", (50000, 10000, 2000), r"are integers beyond 0 to 255 \(2000 to 50000\)"),
        (("diffuse_red", "diffuse_green", "diffuse_blue"), "uchar", (1, 2, 3), "are named diffuse_red, .* red, green"),
        (("r", "g", "b"), "uchar", (1, 2, 3), "are named r, g, b; name them red, green, blue in its header"),
        (("Red", "Green", "Blue"), "uchar", (1, 2, 3), "are named Red, Green, Blue"),
    ],
)
def test_other_colours_are_told(
    tmp_path: Path, names: Sequence[str], kind: str, rgb: Sequence[float], told: str, on: str, text: bool
) -> None:
    path = ply(tmp_path / "a.ply", names, kind, rgb, on=on, text=text)
    with pytest.raises(UserError, match=rf"a\.ply: the colours of its {on} element {told}"):
        tint(path)
