"""Ground truth for model-based UAV localization: rendered inspection flights, trackers, and scores.

For scripts and notebooks; each name is imported when it is first used::

    import uavbench as ub

    ub.evaluate("groundtruth.tum", "estimate.tum", align="se3").frames()
    ub.render("tiny", out="out/tiny")
    ub.start("robust", "box.obj", "camera.toml", cam_from_world).track(image, stamp_ns)
    ub.load_scores("out/tiny")
    ub.figures.success_curves(ub.load_runs("out/tiny"), axes)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from uavbench.trajectories.processes.library_path import keep_library_path

if TYPE_CHECKING:
    from uavbench.bench.own_images.import_sequence import import_sequence
    from uavbench.bench.runner.render_suite import render
    from uavbench.reports import figures_on_axes as figures
    from uavbench.reports.evaluation.api import evaluate
    from uavbench.reports.run_folder import load_runs, load_scores
    from uavbench.scenes.camera import Camera
    from uavbench.scenes.dataset.sequence import Frame, Sequence, open_sequence
    from uavbench.scenes.structure import Structure
    from uavbench.tracker.images.start import start
    from uavbench.trajectories.errors import UserError
    from uavbench.trajectories.pose import Pose
    from uavbench.trajectories.trajectory import Trajectory

__version__ = "0.1.0"

keep_library_path()

__all__ = [
    "Camera",
    "Frame",
    "Pose",
    "Sequence",
    "Structure",
    "Trajectory",
    "UserError",
    "evaluate",
    "figures",
    "import_sequence",
    "load_runs",
    "load_scores",
    "open_sequence",
    "render",
    "start",
]

HOMES = {
    "Camera": "scenes.camera",
    "Frame": "scenes.dataset.sequence",
    "Pose": "trajectories.pose",
    "Sequence": "scenes.dataset.sequence",
    "Structure": "scenes.structure",
    "Trajectory": "trajectories.trajectory",
    "UserError": "trajectories.errors",
    "evaluate": "reports.evaluation.api",
    "figures": "reports.figures_on_axes",
    "import_sequence": "bench.own_images.import_sequence",
    "load_runs": "reports.run_folder",
    "load_scores": "reports.run_folder",
    "open_sequence": "scenes.dataset.sequence",
    "render": "bench.runner.render_suite",
    "start": "tracker.images.start",
}
"""Module of each name; `figures` is a module itself."""


def __getattr__(name: str) -> Any:
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = import_module(f"{__name__}.{HOMES[name]}")
    return globals().setdefault(name, home if name == "figures" else getattr(home, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
