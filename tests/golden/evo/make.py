"""Makes expected.json, and evo's part of expected_association.json, anew from the trajectories beside it, by evo.

The cases stay those that the files hold; only their numbers are computed again: python tests/golden/evo/make.py.
rpg_expected.json and the one-to-one rows of TUM's script need these programs (see their "generator") and stay.
"""

import copy
import hashlib
import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

import evo
import numpy as np
from evo import main_ape, main_rpe
from evo.core import sync
from evo.core.metrics import PoseRelation, Unit
from evo.core.trajectory import PoseTrajectory3D
from evo.tools import file_interface

FOLDER = Path(__file__).parent
Row = dict[str, Any]


@cache
def trajectory(name: str) -> PoseTrajectory3D:
    """One of the files in TUM's format."""
    return file_interface.read_tum_trajectory_file(str(FOLDER / f"{name}.tum"))


@cache
def associated(pair: str, method: str, max_difference_s: float) -> tuple[PoseTrajectory3D, PoseTrajectory3D]:
    """Reference and estimate of a pair, associated."""
    chosen = sync.SyncMethod[method] if isinstance(method, str) else method
    given = copy.deepcopy(trajectory(f"{pair}_gt")), copy.deepcopy(trajectory(f"{pair}_est"))
    return sync.associate_trajectories(*given, sync_method=chosen, max_diff=max_difference_s)


def figures(errors: Any) -> Row:
    """Number and summary of errors (n,)."""
    e = np.asarray(errors)
    stats = {"rmse": np.sqrt((e**2).mean()), "mean": e.mean(), "median": np.median(e), "std": e.std()}
    stats |= {"min": e.min(), "max": e.max(), "sse": (e**2).sum()}
    return {"n": len(e), "stats": {name: float(value) for name, value in stats.items()}}


def ape(pair: str, row: Row, alignments: Row, max_difference_s: float) -> Row:
    """A row of absolute errors with the numbers of evo."""
    both = copy.deepcopy(associated(pair, row["sync"], max_difference_s))
    found = main_ape.ape(*both, PoseRelation[row["relation"]], **alignments[row["align"]])
    made = row | figures(found.np_arrays["error_array"])
    if "alignment_sim3" in row:
        made["alignment_sim3"] = found.np_arrays["alignment_transformation_sim3"].tolist()
    return made


def rpe(pair: str, row: Row, alignments: Row, max_difference_s: float) -> Row:
    """A row of relative errors with the numbers of evo."""
    both = copy.deepcopy(associated(pair, row["sync"], max_difference_s))
    found = main_rpe.rpe(
        *both, PoseRelation[row["relation"]], delta=row["delta"], delta_unit=Unit[row["unit"]],
        rel_delta_tol=row["rel_delta_tol"], all_pairs=row["all_pairs"],
        pairs_from_reference=row["pairs_from_reference"], **alignments[row["align"]],
    )  # fmt: skip
    return row | figures(found.np_arrays["error_array"])


def association(row: Row) -> Row:
    """A row of associations with the numbers of evo."""
    reference, estimate = associated("D_assoc", "nearest_time", row["t_max_diff"])
    found = main_ape.ape(*copy.deepcopy((reference, estimate)), PoseRelation.translation_part, align=True)
    made = {
        "n": len(reference.timestamps),
        "unique_ref": len(np.unique(reference.timestamps)),
        "ref_stamps": reference.timestamps.tolist(),
        "est_stamps": estimate.timestamps.tolist(),
        "ape_se3": figures(found.np_arrays["error_array"])["stats"],
    }
    return row | {"evo": row["evo"] | made}


def main() -> int:
    """Write both files; 1 when the trajectories are not those that the cases were made for."""
    path = FOLDER / "expected.json"
    expected = json.loads(path.read_text(encoding="utf-8"))
    for pair, rows in expected["pairs"].items():
        for name, digest in rows["files"].items():
            if hashlib.sha256((FOLDER / name).read_bytes()).hexdigest() != digest:
                print(f"{name}: not the file that expected.json was made of")
                return 1
        given = expected["generator"]["alignment_kwargs"], rows["t_max_diff"]
        rows["ape"] = [ape(pair, row, *given) for row in rows["ape"]]
        rows["rpe"] = [rpe(pair, row, *given) for row in rows["rpe"]]
    expected["generator"] |= {"evo": evo.__version__.removeprefix("v"), "numpy": np.__version__}
    path.write_text(json.dumps(expected, indent=1) + "\n", encoding="utf-8")
    path = FOLDER / "expected_association.json"
    expected = json.loads(path.read_text(encoding="utf-8"))
    expected["cases"] = [association(row) for row in expected["cases"]]
    path.write_text(json.dumps(expected, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
