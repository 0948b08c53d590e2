"""Speed of rendering against its goals: final frames of 640 x 480 px per second of processor time on one core.

A final frame has antialiasing, shadows and noise, and is written as PNG with its ground truth.
The benchmarks of two processes measure wall-clock time and need an otherwise idle machine; their files are in memory.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ctypes.util import find_library
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from uavbench.bench.config.suite import load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.bench.speed.rounds import absent, figure
from uavbench.scenes.camera_path import mounted_path
from uavbench.scenes.dataset.surfaces.surface_truth import SurfaceFiles
from uavbench.scenes.effects.exposure import RollingShutter
from uavbench.scenes.effects.image_sensor import Noise
from uavbench.scenes.filming.film import with_effects
from uavbench.scenes.filming.frames import Filming, write_annotations, write_image
from uavbench.scenes.rendering.camera_simulator import ideal_camera, render_camera
from uavbench.scenes.rendering.context import functions, is_llvmpipe
from uavbench.scenes.rendering.gpu import Program, Target
from uavbench.scenes.scene import build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.sensors.sensor import sample_stamps
from uavbench.trajectories.simulation.flight import fly

ASKED_FPS = {"box": 60.0, "bridge": 25.0}
RENDERED_ANNOTATIONS: tuple[Any, ...] = ("depth", "mask", "edges")
ANNOTATIONS = (*RENDERED_ANNOTATIONS, "flow", "normals")
"""All of them: flow and normals trace every pixel."""
FRAMES = 40
COVERS = 20
"""Times that an image is covered between two looks at the clock."""
FILL_ROUNDS = 5
LOOP = "loop"
"""In place of a suite: work that needs nothing but a core."""
COUNTED = 1_000_000
"""Numbers added in place of a frame, which takes about as long."""
VERTEX = """#version 330 core
void main() {
    gl_Position = vec4(vec2((gl_VertexID << 1) & 2, gl_VertexID & 2) * 2.0 - 1.0, 0.5, 1.0);
}
"""
FRAGMENT = """#version 330 core
layout(location = 0) out vec4 colour;
layout(location = 1) out vec2 numbers;
void main() {
    colour = vec4(0.5);
    numbers = vec2(0.5);
}
"""
by_processor_time = pytest.mark.benchmark(timer=time.process_time)


def first_of(suite: str) -> SequenceSpec:
    """The first sequence of a suite."""
    spec = load_suite(suite_file(suite)).sequences[0]
    assert isinstance(spec, SequenceSpec)
    return spec


@contextmanager
def frame_maker(spec: SequenceSpec, folder: Path) -> Iterator[Callable[[], None]]:
    """A function that writes the next of 2 * FRAMES + 3 frames, evenly spread over a sequence, as `generate` does."""
    cv2.setNumThreads(1)
    scene = build_scene(spec)
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    mount = spec.mount.along(flight, scene.obstacles.centre)
    camera = spec.camera.camera()
    pinhole, lens = render_camera(camera, max((getattr(e, "margin_px", 0) for e in spec.effects), default=0))
    all_stamps = sample_stamps(flight, spec.rate_hz)
    stamps = iter(all_stamps[np.linspace(0, len(all_stamps) - 1, 2 * FRAMES + 3).astype(int)].tolist())
    numbers = count()
    (folder / "frames").mkdir(parents=True)
    with scene.renderer(pinhole.width, pinhole.height) as renderer:
        ideal = ideal_camera(renderer, camera, pinhole, lens, mounted_path(flight, mount))
        source = with_effects(ideal, spec.effects, spec.seed)
        surfaces = SurfaceFiles.asked(folder, spec.annotations, renderer, source)
        filming = Filming(source=source, mount=mount, structure=scene.built.structure, surfaces=surfaces)

        def make() -> None:
            stamp_ns, number = next(stamps), next(numbers)
            image = source.frame(stamp_ns)
            assert image is not None
            write_image(folder / "frames" / f"{number:06d}.png", image)
            write_annotations(folder, spec, number, filming, image, stamp_ns)

        yield make


def timed(benchmark: Any, spec: SequenceSpec, folder: Path) -> float:
    """Mean time in s of a final frame."""
    with frame_maker(spec, folder) as make:
        benchmark.pedantic(make, rounds=FRAMES, warmup_rounds=3)
    return float(benchmark.stats["mean"])


@by_processor_time
@pytest.mark.parametrize("annotations", [(), RENDERED_ANNOTATIONS], ids=["pose", "depth-mask-edges"])
@pytest.mark.parametrize("suite", list(ASKED_FPS))
def test_final_frames(benchmark: Any, tmp_path: Path, suite: str, annotations: tuple[Any, ...]) -> None:
    """Frames of a suite's first sequence without its motion blur; the bridge includes its trees and birds."""
    fps = 1 / timed(benchmark, replace(first_of(suite), effects=(Noise(),), annotations=annotations), tmp_path)
    benchmark.extra_info.update(fps=fps, times_asked=fps / ASKED_FPS[suite])


def fill_s(width: int, height: int) -> float:
    """Least processor time in s in which one triangle covers every pixel of a frame's target once, depth and all."""
    GL = functions()
    target, program, vertices = (
        Target(GL, width, height, numbered=True),
        Program(GL, VERTEX, FRAGMENT),
        GL.glGenVertexArrays(1),
    )
    GL.glViewport(0, 0, width, height)
    GL.glDisable(GL.GL_CULL_FACE)
    GL.glEnable(GL.GL_DEPTH_TEST)
    GL.glDepthFunc(GL.GL_ALWAYS)
    program.use()
    GL.glBindVertexArray(vertices)
    times = []
    for _ in range(FILL_ROUNDS + 1):
        begin = time.process_time()
        for _ in range(COVERS):
            GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
            GL.glFinish()
        times.append((time.process_time() - begin) / COVERS)
    GL.glDeleteVertexArrays(1, [vertices])
    GL.glDeleteProgram(program.id)
    target.delete()
    return min(times[1:])


@by_processor_time
@pytest.mark.parametrize("suite", list(ASKED_FPS))
def test_final_frames_against_the_raw_fill_rate(benchmark: Any, tmp_path: Path, suite: str) -> None:
    """Pixels of the same frames per second, over those that one triangle of one colour covers."""
    spec = replace(first_of(suite), effects=(Noise(),), annotations=RENDERED_ANNOTATIONS)
    frame_s, fill = timed(benchmark, spec, tmp_path), fill_s(spec.camera.width, spec.camera.height)
    benchmark.extra_info.update(percent_of_fill_rate=100 * fill / frame_s, fill_fps=1 / fill)


@by_processor_time
@pytest.mark.parametrize("suite", list(ASKED_FPS))
def test_final_frames_with_flow_and_normals(benchmark: Any, tmp_path: Path, suite: str) -> None:
    """Frames as above with all annotations, against the same goal."""
    fps = 1 / timed(benchmark, replace(first_of(suite), effects=(Noise(),), annotations=ANNOTATIONS), tmp_path)
    benchmark.extra_info.update(fps=fps, times_asked=fps / ASKED_FPS[suite])


@by_processor_time
@pytest.mark.parametrize("suite", list(ASKED_FPS))
def test_rolling_shutter_against_a_plain_frame(benchmark: Any, tmp_path: Path, suite: str) -> None:
    """Frames with a rolling shutter, relative to the same frames with an instantaneous global one."""
    spec = replace(first_of(suite), effects=(Noise(),))
    with frame_maker(spec, tmp_path / "plain") as make:
        for _ in range(3):
            make()
        begin = time.process_time()
        for _ in range(FRAMES):
            make()
        plain_s = (time.process_time() - begin) / FRAMES
    rolling_s = timed(benchmark, replace(spec, effects=(RollingShutter(), Noise())), tmp_path / "rolling")
    benchmark.extra_info["times_a_plain_frame"] = rolling_s / plain_s


@by_processor_time
@pytest.mark.parametrize("suite", list(ASKED_FPS))
def test_building_a_scene(benchmark: Any, suite: str) -> None:
    """Structure, textures and light: the set-up time of a sequence before its first frame."""
    spec = first_of(suite)
    benchmark.pedantic(lambda: build_scene(spec), rounds=3, warmup_rounds=1)


def start(suite: str, platform: str = "egl") -> subprocess.Popen[str]:
    """Start `main` in a process; it has built its scene and waits for a line."""
    environment = {**os.environ, "UAVBENCH_GL": platform}
    command = [sys.executable, __file__, suite]
    process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def finish(processes: list[subprocess.Popen[str]]) -> list[tuple[float, float]]:
    """Let all processes render at once; wall-clock and processor time in s of each."""
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    words = [process.communicate()[0].split() for process in processes]
    return [(float(clock), float(processor)) for clock, processor in words]


def test_osmesa_against_egl(benchmark: Any) -> None:
    """Ratio of the processor times of the same frames through EGL and OSMesa."""
    if find_library("OSMesa") is None:
        absent(benchmark, "OSMesa (Debian's libosmesa6)")
        return

    def ratio() -> float:
        egl_s, osmesa_s = (finish([start("box", platform)])[0][1] for platform in ("egl", "osmesa"))
        return egl_s / osmesa_s

    figure(benchmark, "osmesa_speed_over_egl", ratio, rounds=3)


def times_one(work: str) -> float:
    """Work per second of two processes together over that of one alone."""
    alone_s = finish([start(work)])[0][0]
    return 2 * alone_s / max(clock_s for clock_s, _ in finish([start(work), start(work)]))


@pytest.mark.parametrize("suite", list(ASKED_FPS))
def test_two_processes_against_one(benchmark: Any, suite: str) -> None:
    """Wall-clock: frames per second of two processes together over those of one alone."""
    figure(benchmark, "times_one", lambda: times_one(suite))


def test_two_loops_against_one(benchmark: Any) -> None:
    """Wall-clock: the same of processes that only count, so that they share no cache, file or driver."""
    figure(benchmark, "times_one", lambda: times_one(LOOP))


@pytest.mark.parametrize("suite", list(ASKED_FPS))
def test_all_cores_with_a_gpu(benchmark: Any, suite: str) -> None:
    """Wall-clock: frames per second of a process on each core, all drawn by one GPU."""
    if is_llvmpipe():
        absent(benchmark, "a GPU")
        return
    cores = len(os.sched_getaffinity(0))

    def fps() -> float:
        times = finish([start(suite) for _ in range(cores)])
        return cores * 2 * FRAMES / max(clock_s for clock_s, _ in times)

    figure(benchmark, "fps", fps, rounds=3)


@contextmanager
def maker(work: str) -> Iterator[Callable[[], object]]:
    """A function that makes the next frame of a suite, its files in memory; it counts where `work` is LOOP."""
    if work == LOOP:
        yield lambda: sum(range(COUNTED))
        return
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(dir=memory) as folder, frame_maker(first_of(work), Path(folder)) as make:
        yield make


def main(work: str) -> None:
    """Build the scene, print `ready`, wait for a line, render 2 * FRAMES frames (or count), print both times in s."""
    with maker(work) as make:
        make()
        print("ready", flush=True)
        sys.stdin.readline()
        clock, processor = time.perf_counter(), time.process_time()
        for _ in range(2 * FRAMES):
            make()
        print(time.perf_counter() - clock, time.process_time() - processor)


if __name__ == "__main__":
    main(sys.argv[1])
