"""Suites so small that a test can run them."""

SMALL = """
title = "small"
seeds = [0, 1]
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
environment = { kind = "indoor" }
flight.path = { kind = "hand-pilot", duration_s = 0.3 }
camera = { width = 160, height = 120, horizontal_fov_deg = 65.0 }
[trackers]
hold = { kind = "hold" }
"""

LOOP = '[loop]\nlatency = { kind = "constant", ms = 20.0 }\ncorridor_m = 0.4\ncoverage_px_m = 20.0\n'
FLOWN = (
    SMALL.replace('{ kind = "indoor" }', '{ kind = "studio" }\nsensors = [{ kind = "imu" }]').replace(
        "seeds = [0, 1]", "seeds = [0]"
    )
    + 'truth = { kind = "truth" }\n'
    + LOOP
)
"""A flight in closed loop, on `truth` and on `hold`."""


def small_suite(folder, more=""):
    """File of two short flights tracked by `hold`; `more` is added to its trackers."""
    path = folder / "small.toml"
    path.write_text(SMALL + more)
    return path
