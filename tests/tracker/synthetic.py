"""A quick ray caster of textured boxes, to test trackers without the renderer."""

from uavbench.bench.speed.synthetic import *  # noqa: F403, what the benchmarks are shown, too
