"""Named random streams: adding one never changes the numbers of another."""

import hashlib
import hmac

import numpy as np

OPEN_SEED_BITS = 63
"""Maximum bits of a seed in a suite file; a longer seed is the secret of a challenge."""


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """Generator of the stream called `names` under `seed` (an integer >= 0; 0 is a seed like any other).

    The names enter numpy's SeedSequence as its spawn key, so two streams are independent
    and a stream depends on nothing but the seed and its own name. SeedSequence can be inverted: the state of one stream
    reveals those of the others. Therefore, under a seed of more than OPEN_SEED_BITS, each stream is seeded by an HMAC
    (RFC 2104) of its name.
    """
    if seed.bit_length() > OPEN_SEED_BITS:
        key = seed.to_bytes((seed.bit_length() + 7) // 8, "big")
        own = hmac.digest(key, "/".join(str(name) for name in names).encode(), "sha256")
        return np.random.Generator(np.random.PCG64(int.from_bytes(own, "big")))
    digest = hashlib.sha256("/".join(str(name) for name in names).encode()).digest()
    words = tuple(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=words)))
