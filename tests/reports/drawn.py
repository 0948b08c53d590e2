"""A small sequence drawn without a renderer, and results on it."""

from uavbench.bench.speed.drawn import *  # noqa: F403, what the benchmarks are shown, too
