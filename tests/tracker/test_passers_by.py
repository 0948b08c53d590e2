"""Somebody who walks before the structure does not draw the track along."""

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

WALK_BEFORE = 1031, slice(60, 78, 3)
"""A flight at five frames a second, from where people before the box begin to walk: seed and frames."""


def film(seed, frames):
    """Structure, camera, stamps in ns, poses and images of these frames."""
    suite = load_suite(suite_file("occlusion"))
    spec = next(each for each in suite.sequences if "shadows" in each.name)
    spec = replace(spec, seed=seed)
    scene = build_scene(spec)
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    camera = spec.camera.camera()
    pinhole, lens = render_camera(camera, 0)
    stamps_ns = sample_stamps(flight, spec.rate_hz)[frames].tolist()
    path = camera_path(flight, spec.mount.at_rest.cam_from_body)
    with scene.renderer(pinhole.width, pinhole.height) as renderer:
        source = with_effects(ideal_camera(renderer, camera, pinhole, lens, path), spec.effects, spec.seed)
        images = [grey(encode(source.image(stamp_ns))) for stamp_ns in stamps_ns]
    structure: Structure = scene.built.structure
    return structure, camera, stamps_ns, [path(each) for each in stamps_ns], images


def largest_error_m(structure, camera, stamps_ns, poses, images):
    run = Robust().start(structure, camera, poses[0], np.random.default_rng(0))
    errors_m = []
    for image, stamp_ns, pose in zip(images, stamps_ns, poses, strict=True):
        found = run.track(image, stamp_ns)
        assert found.status == "ok"
        errors_m.append(np.linalg.norm((found.cam_from_world @ pose.inverse()).log()[:3]))
    return max(errors_m)


def test_people_who_begin_to_walk_before_a_face_do_not_draw_the_pose_along():
    structure, camera, stamps_ns, poses, images = film(*WALK_BEFORE)
    assert len(images) == 6
    assert largest_error_m(structure, camera, stamps_ns, poses, images) < 0.03, "of a box 4 to 6 m away"
