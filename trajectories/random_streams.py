"""Named random streams: adding one never shifts another's numbers."""

import hashlib

import numpy as np


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """Generator of the stream called `names` under `seed` (an integer >= 0; 0 is a seed like any other).

    The names enter numpy's SeedSequence as its spawn key, so two streams are independent
    and a stream depends on nothing but the seed and its own name.
    """
    digest = hashlib.sha256("/".join(str(name) for name in names).encode()).digest()
    key = tuple(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))
