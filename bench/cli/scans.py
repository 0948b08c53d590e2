"""The command over scans: planes."""

from pathlib import Path
from typing import Any

import click

from uavbench.bench.cli.values import FILE
from uavbench.bench.said import say
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.folders import try_place
from uavbench.trajectories.files.origin import refuse_foreign_file


@click.command("planes")
@click.argument("scan", type=FILE)
@click.option("--out", type=FILE, required=True, help="OBJ file; a picture of the edges is written beside it.")
@click.option("--unit", type=click.Choice(["m", "mm", "cm", "in", "ft"]), default="m", show_default=True)
@click.option("--up", type=click.Choice(["auto", "y", "z"]), default="auto", show_default=True)
@click.option(
    "--min-area-m2", type=click.FloatRange(0), default=0.0, help="Smallest plane; default: by the scan's triangles."
)
def planes_command(scan: Path, out: Path, unit: Any, up: Any, min_area_m2: float) -> None:
    """Find the planes of a scanned mesh SCAN, and write the polygons that they bound as a model with few edges.

    The model is in metres, z up, and has the origin of the scan.
    """
    import numpy as np

    from uavbench.scenes.model_files.mesh_file import MeshFile
    from uavbench.scenes.scans.planar_files import PLANAR, write_edge_picture, write_planar_model
    from uavbench.scenes.scans.planar_model import PlanarModel
    from uavbench.tracker.images.model_size import FAR

    if out.suffix != ".obj":
        raise UserError(f"--out {out}: the model is written as OBJ; name a file such as model.obj")
    picture = out.with_suffix(".png")
    for path in (out, picture):
        refuse_foreign_file(path, PLANAR)
        try_place(path)
    mesh = MeshFile(path=str(scan), unit=unit, up=up, keep_origin=True, allow_open=True).mesh()
    try:
        model = PlanarModel.of(mesh.vertices, mesh.triangles, min_area_m2)
    except ValueError as error:
        raise UserError(f"{scan}: {error}; is it a scan of a structure with planes?") from None
    structure = model.structure()
    write_planar_model(model, out)
    write_edge_picture(structure, mesh.vertices[mesh.triangles], picture)
    size_m = float(np.ptp(model.vertices, axis=0).max())
    if unit == "m" and size_m >= FAR:
        say(f"doubt: the model is {size_m:,.4g} m large: is the scan in millimetres? Then give --unit mm", err=True)
    say(f"{model.planes} planes with {len(structure.edges)} edges in {len(mesh.triangles):,} triangles")
    say(f"noise {1000 * model.noise_m:.2g} mm, sides of triangles {1000 * model.side_m:.2g} mm")
    say(f"relief of less than {1000 * model.reach_m:.2g} mm is taken for rounding")
    say(f"{100 * model.left_out:.1f} % of the surface lies in no plane, and is left out")
    say(f"edges over the scan, borders of a single plane in red: {picture}")
    say(out)


COMMANDS: tuple[click.Command, ...] = (planes_command,)
