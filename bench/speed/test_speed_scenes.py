"""Speed of rendering: final frames per second on one core, with noise, PNG and truth (run alone, LP_NUM_THREADS=0)."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.config import load_suite
from bench.suite_files import suite_file
from scenes import generate as g
from scenes.light import encode
from scenes.source import make_source, render_camera
from scenes.spec import SequenceSpec
from trajectories.flight import fly

ASKED_FPS = {"paper": 25.0, "bridge": 12.0}


def frame_maker(spec: SequenceSpec, folder: Path) -> tuple[Callable[[int], None], Any]:
    """Function that renders and writes frame k as `generate` does, and the renderer to close."""
    scene = g.build_scene(spec)
    flight = fly(spec.flight, spec.mount, scene.surroundings, spec.seed)
    camera = spec.camera.camera()
    pinhole, lens = render_camera(camera)
    renderer = scene.renderer(pinhole.width, pinhole.height)
    ideal = make_source(renderer, camera, pinhole, lens, g.camera_path(flight, spec.mount.cam_from_body))
    source = g.with_effects(ideal, spec.effects, spec.seed)
    rows = flight.frame_rows(spec.rate_hz)

    def make(k: int) -> None:
        image = source.image(int(flight.stamps_ns[rows[k % len(rows)]]))
        assert image is not None
        g._write_image(folder / "frame.png", encode(image))

    return make, renderer


@pytest.mark.parametrize("suite", list(ASKED_FPS))
def test_final_frames(benchmark: Any, tmp_path: Path, suite: str) -> None:
    """Frames as they are written, one by one, of a suite's first sequence."""
    make, renderer = frame_maker(load_suite(suite_file(suite)).sequences[0], tmp_path)
    counter = iter(range(10**9))
    with renderer:
        benchmark.pedantic(lambda: make(next(counter)), rounds=60, warmup_rounds=5)
    benchmark.extra_info["asked_fps"] = ASKED_FPS[suite]
    benchmark.extra_info["fps"] = 1 / benchmark.stats["median"]


@pytest.mark.parametrize("platform", ["egl", "osmesa"])
def test_a_process_of_its_own(benchmark: Any, platform: str) -> None:
    """The whole smallest suite's first sequence in a fresh process, by the GL platform."""
    code = (
        "import tempfile; from pathlib import Path; from bench.config import load_suite;"
        "from bench.suite_files import suite_file;"
        "from scenes.generate import generate;"
        "generate(load_suite(suite_file('tiny')).sequences[0], Path(tempfile.mkdtemp()) / 's', content_hash='x')"
    )
    environment = {**os.environ, "UAVBENCH_GL": platform, "LP_NUM_THREADS": "0"}
    benchmark.pedantic(lambda: subprocess.run([sys.executable, "-c", code], env=environment, check=True), rounds=2)
