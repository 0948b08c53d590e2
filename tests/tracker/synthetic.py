"""A quick ray caster of textured boxes, to test trackers without the renderer."""

from functools import cache

import numpy as np

from uavbench.bench.speed import synthetic
from uavbench.bench.speed.synthetic import *  # noqa: F403, what the benchmarks are shown, too
from uavbench.bench.speed.synthetic import CAMERA, SyntheticFlight, box_corners, orbit

DRAWN, MOST_DRAWN = {}, 128
"""Images by all that they show, the oldest first, each with the state of the source of noise after it."""


class Scene(synthetic.Scene):
    """As the benchmarks' own, which draws each image anew: a third of those that tests look at were drawn before."""

    def render(self, cam_from_world, camera=CAMERA, noise_rng=None, supersample=2):
        shown = [*self.boxes, cam_from_world.rotation, cam_from_world.translation]
        noise = repr(noise_rng.bit_generator.state) if noise_rng else None
        floor = int(self.floor.reshape(-1).view(np.uint64).sum())  # a test may have painted it
        key = self.seed, *(each.tobytes() for each in shown), floor, camera, supersample, noise
        if key not in DRAWN:
            if len(DRAWN) == MOST_DRAWN:
                del DRAWN[next(iter(DRAWN))]
            image = super().render(cam_from_world, camera, noise_rng, supersample)
            DRAWN[key] = image, noise_rng and noise_rng.bit_generator.state
        image, state = DRAWN[key]
        if noise_rng:
            noise_rng.bit_generator.state = state
        return image.copy()


@cache
def _seen(seed):
    """A scene, its source of noise, and the frames so far of a flight: a longer one begins with those of a shorter."""
    return Scene([box_corners()], seed=seed), np.random.default_rng(seed), []


def flown(frames: int, seed: int) -> SyntheticFlight:
    """As the benchmarks' own, which draws each frame of each flight anew."""
    poses = orbit(frames, seed=seed)
    scene, rng, images = _seen(seed)
    images += [scene.render(pose, noise_rng=rng) for pose in poses[len(images) :]]
    return SyntheticFlight(poses, [image.copy() for image in images[:frames]])
