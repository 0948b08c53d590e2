"""Vertices of OBJ files that were rounded before they were written, far from the origin."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from uavbench.scenes.model_files.mesh_file import MeshFile
from uavbench.trajectories.errors import UserError

UTM_M = (448_123.37, 5_411_234.71, 312.2)
"""Easting, northing and height of a building."""
Write = Callable[[float], str]


def tower(path: Path, write: Write, place: tuple[float, float, float] = UTM_M) -> Path:
    """An eight-sided tower at a place, its numbers as `write` has them."""
    mesh = trimesh.creation.cylinder(radius=3.17, height=9.03, sections=8)
    lines = ["v " + " ".join(map(write, vertex)) for vertex in (mesh.vertices + place).tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("write", "step"),
    [
        (lambda x: repr(float(np.float32(x))), "0.5"),
        (lambda x: f"{np.float32(x):.6f}", "0.5"),
        (lambda x: f"{np.float32(x):.3f}", "0.5"),
        (lambda x: f"{x:g}", "10"),
        (lambda x: f"{x:.5e}", "10"),
        (lambda x: f"{x:e}", "1"),
    ],
    ids=["all digits of 32 bits", "six decimals", "three decimals", "six digits", "six, exponents", "seven digits"],
)
def test_vertices_that_were_rounded_before_they_were_written_are_told(tmp_path: Path, write: Write, step: str) -> None:
    path = tower(tmp_path / "far.obj", write)
    with pytest.raises(UserError, match=rf"far.obj: .* 5,411,2[34]\d units, .* round them to {step}; move the"):
        MeshFile(path=str(path)).build(np.random.default_rng(0))


@pytest.mark.parametrize(
    ("write", "place"),
    [
        (lambda x: f"{x:.3f}", UTM_M),
        (lambda x: f"{x:.2f}", UTM_M),
        (lambda x: f"{round(4 * x) / 4}", UTM_M),
        (lambda x: f"{round(8 * x) / 8}", UTM_M),
        (lambda x: repr(float(np.float32(x))), (12.3, 45.6, 7.8)),
        (lambda x: f"{x:g}", (12.3, 45.6, 7.8)),
        (lambda x: f"{x:.9e}", UTM_M),
    ],
    ids=["millimetres", "centimetres", "quarters", "eighths", "near, 32 bits", "near, six digits", "exponents"],
)
def test_vertices_with_the_digits_that_a_model_needs_are_read(
    tmp_path: Path, write: Write, place: tuple[float, float, float]
) -> None:
    built = MeshFile(path=str(tower(tmp_path / "tower.obj", write, place))).build(np.random.default_rng(0))
    assert np.ptp(built.structure.vertices[:, 2]) == pytest.approx(9.03, abs=0.3)
