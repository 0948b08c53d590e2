"""The secret of a challenge: 256 random bits from which the seeds of its sequences are derived.

The seeds in a suite's file are small numbers, with which participants could render the ground truth themselves.
"""

import hmac
import os
import re
import secrets
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.placing import rename_new
from uavbench.trajectories.files.reading import read_toml
from uavbench.trajectories.files.temporary_names import temporary

SECRET_BYTES = 32
MOST_OF_ONE_DIGIT = 20
"""Most repetitions of a digit among the 64; a random secret exceeds it with a probability of 2e-9."""


@dataclass(frozen=True, repr=False)
class Secret:
    """A key (32 bytes), and values derived from it by the HMAC (RFC 2104) of their names."""

    key: bytes

    def derived(self, *names: str) -> bytes:
        """32 bytes derived from a name; they reveal neither the key nor the bytes of other names."""
        return hmac.digest(self.key, "\0".join(names).encode(), "sha256")

    def seed(self, sequence: str) -> int:
        """Seed of a sequence: 256 bits with the highest bit set, so that no seed of a suite can equal it."""
        return int.from_bytes(self.derived("seed", sequence), "big") | 1 << (8 * SECRET_BYTES - 1)

    def identifier(self, what: str) -> str:
        """Public identifier (16 hexadecimal digits) of a name."""
        return self.derived("identifier", what).hex()[:16]


def read_or_make(path: Path) -> Secret:
    """Read a secret from a file, or create the file with a random one if it is missing; UserError for a weak secret."""
    if not os.path.lexists(path):
        _make(path)
    given = read_toml(path).get("secret")
    if not (isinstance(given, str) and re.fullmatch("[0-9a-f]{64}", given)):
        raise UserError(
            f'{path}: expected secret = "...", 64 hexadecimal digits (256 bits); choose a new file, and it is made'
        )
    if max(Counter(given).values()) > MOST_OF_ONE_DIGIT:
        raise UserError(f"{path}: this secret can be guessed; choose a new file, and a secret is created")
    return Secret(bytes.fromhex(given))


def _make(path: Path) -> None:
    """Write a new secret to a file that only its owner can read."""
    text = (
        "# Whoever has this can render the ground truth of the challenge. Keep it until the challenge is over.\n"
        f'secret = "{secrets.token_hex(SECRET_BYTES)}"\n'
    )
    with temporary(path) as own:
        handle = os.open(own.made, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(handle)
        with suppress(FileExistsError):  # another process was faster
            rename_new(own.made, path)
