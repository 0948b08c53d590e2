"""A quick ray caster of textured boxes, to test trackers without the renderer."""

from functools import cache

import numpy as np

from uavbench.bench.speed.synthetic import *  # noqa: F403, what the benchmarks are shown, too
from uavbench.bench.speed.synthetic import Scene, SyntheticFlight, box_corners, orbit


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
