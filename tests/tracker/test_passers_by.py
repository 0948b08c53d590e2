"""Somebody who walks along an edge of the structure does not draw the track along."""

from dataclasses import replace

import numpy as np
import pytest

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

COMES_OUT = 1001, slice(85, None), 320, 240
"""A flight at whose end one of the people comes out from behind the left edge of a box: seed and frames; width and
height of the part of its images in which hardly a patch but this edge tells the way to the side."""
WALKS_BEFORE = 1031, slice(0, 60, 3), 640, 480
"""Another one, at five frames a second: people before the box stand still at first, then walk."""


def film(seed, frames, width, height):
    """Structure, camera, stamps in ns, poses and images of these frames, cut to a width and height."""
    suite = load_suite(suite_file("occlusion"))
    spec = next(each for each in suite.sequences if "shadows" in each.name)
    spec = replace(spec, seed=seed)
    scene = build_scene(spec)
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    camera = spec.camera.camera()
    pinhole, lens = render_camera(camera, 0)
    stamps_ns = sample_stamps(flight, spec.rate_hz)[frames].tolist()
    left, top = (camera.width - width) // 2, (camera.height - height) // 2
    path = camera_path(flight, spec.mount.at_rest.cam_from_body)
    with scene.renderer(pinhole.width, pinhole.height) as renderer:
        source = with_effects(ideal_camera(renderer, camera, pinhole, lens, path), spec.effects, spec.seed)
        images = [grey(encode(source.image(stamp_ns))) for stamp_ns in stamps_ns]
    images = [np.ascontiguousarray(each[top : top + height, left : left + width]) for each in images]
    narrow = replace(camera, width=width, height=height, cx=camera.cx - left, cy=camera.cy - top)
    structure: Structure = scene.built.structure
    return structure, narrow, stamps_ns, [path(each) for each in stamps_ns], images


def largest_error_m(structure, camera, stamps_ns, poses, images):
    run = Robust().start(structure, camera, poses[0], np.random.default_rng(0))
    errors_m = []
    for image, stamp_ns, pose in zip(images, stamps_ns, poses, strict=True):
        found = run.track(image, stamp_ns)
        assert found.status == "ok"
        errors_m.append(np.linalg.norm((found.cam_from_world @ pose.inverse()).log()[:3]))
    return max(errors_m)


@pytest.mark.parametrize(("flight", "frames"), [(COMES_OUT, 40), (WALKS_BEFORE, 20)])
def test_somebody_who_walks_along_an_edge_or_a_face_does_not_draw_it_along(flight, frames):
    structure, camera, stamps_ns, poses, images = film(*flight)
    assert len(images) == frames
    assert largest_error_m(structure, camera, stamps_ns, poses, images) < 0.03, "of a box 4 to 6 m away"
