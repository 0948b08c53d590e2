"""Somebody who walks along an edge of the structure does not draw the track along."""

from dataclasses import replace

import numpy as np

from uavbench.bench.config.suite import load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.scenes.camera_path import camera_path
from uavbench.scenes.filming.film import with_effects
from uavbench.scenes.rendering.camera_simulator import ideal_camera, render_camera
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import build_scene
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.shang_shen.segments import grey
from uavbench.trajectories.sensors.sensor import sample_stamps
from uavbench.trajectories.simulation.flight import fly

SEED, FIRST, WIDTH, HEIGHT = 1001, 85, 320, 240
"""A flight at whose end one of the people comes out from behind the left edge of a box, from its frame FIRST on; the
part of its images in which hardly a patch but this edge tells the way to the side."""


def film():
    """Structure, narrow camera, stamps in ns, poses and images of these frames."""
    suite = load_suite(suite_file("occlusion"))
    spec = next(each for each in suite.sequences if "shadows" in each.name)
    spec = replace(spec, seed=SEED)
    scene = build_scene(spec)
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    camera = spec.camera.camera()
    pinhole, lens = render_camera(camera, 0)
    stamps_ns = sample_stamps(flight, spec.rate_hz)[FIRST:].tolist()
    left, top = (camera.width - WIDTH) // 2, (camera.height - HEIGHT) // 2
    path = camera_path(flight, spec.mount.at_rest.cam_from_body)
    with scene.renderer(pinhole.width, pinhole.height) as renderer:
        source = with_effects(ideal_camera(renderer, camera, pinhole, lens, path), spec.effects, spec.seed)
        images = [grey(encode(source.image(stamp_ns))) for stamp_ns in stamps_ns]
    images = [np.ascontiguousarray(each[top : top + HEIGHT, left : left + WIDTH]) for each in images]
    narrow = replace(camera, width=WIDTH, height=HEIGHT, cx=camera.cx - left, cy=camera.cy - top)
    structure: Structure = scene.built.structure
    return structure, narrow, stamps_ns, [path(each) for each in stamps_ns], images


def test_somebody_who_comes_out_from_behind_an_edge_does_not_draw_it_along():
    structure, camera, stamps_ns, poses, images = film()
    run = Robust().start(structure, camera, poses[0], np.random.default_rng(0))
    errors_m = []
    for image, stamp_ns, pose in zip(images, stamps_ns, poses, strict=True):
        found = run.track(image, stamp_ns)
        assert found.status == "ok"
        errors_m.append(np.linalg.norm((found.cam_from_world @ pose.inverse()).log()[:3]))
    assert len(images) == 40
    assert max(errors_m) < 0.03, "of a box 5.4 m away"
