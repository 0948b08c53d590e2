"""The secret of a challenge: 256 random bits from which the seeds of its sequences are derived.

A suite's own seeds are small numbers in its file, with which participants could render the ground truth.
"""

import hmac
import os
import re
import secrets
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.reading import read_toml

SECRET_BYTES = 32
MOST_OF_ONE_DIGIT = 20
"""Of the 64 digits: in a random secret some digit is there more often with a probability of 2e-9."""


@dataclass(frozen=True, repr=False)
class Secret:
    """A key (32 bytes) and what is derived from it, each by the HMAC (RFC 2104) of a name."""

    key: bytes

    def derived(self, *names: str) -> bytes:
        """32 bytes derived from a name, which reveal neither the key nor those of another name."""
        return hmac.digest(self.key, "\0".join(names).encode(), "sha256")

    def seed(self, sequence: str) -> int:
        """Seed of a sequence: 256 bits, the first of them set, so that it is longer than any seed of a suite."""
        return int.from_bytes(self.derived("seed", sequence), "big") | 1 << (8 * SECRET_BYTES - 1)

    def identifier(self, what: str) -> str:
        """Public identifier (16 hexadecimal digits) of something."""
        return self.derived("identifier", what).hex()[:16]


def read_or_make(path: Path) -> Secret:
    """Secret of a file, which is created with a random one if missing; UserError for a weak secret."""
    if not os.path.lexists(path):
        _make(path)
    given = read_toml(path).get("secret")
    if not (isinstance(given, str) and re.fullmatch("[0-9a-f]{64}", given)):
        raise UserError(
            f'{path}: expected secret = "...", 64 hexadecimal digits (256 bits); name a file that is not there yet, '
            "and it is made"
        )
    if max(Counter(given).values()) > MOST_OF_ONE_DIGIT:
        raise UserError(f"{path}: this secret can be guessed; name a file that is not there yet, and one is made")
    return Secret(bytes.fromhex(given))


def _make(path: Path) -> None:
    """Write a new secret that its owner alone can read."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = (
        "# Whoever has this can render the ground truth of the challenge. Keep it until the challenge is over.\n"
        f'secret = "{secrets.token_hex(SECRET_BYTES)}"\n'
    )
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(handle)
