"""Which machine and which boot a process runs on, so that what it left can be told from what another one works on."""

import contextlib
import hashlib
import os
import socket
from dataclasses import dataclass
from functools import cache
from pathlib import Path

BOOT, IDENTITY, NAMESPACE = "/proc/sys/kernel/random/boot_id", "/etc/machine-id", "/proc/self/ns/pid"
MOUNTS = "/proc/self/mountinfo"
LOCAL = frozenset({"ext2", "ext3", "ext4", "xfs", "btrfs", "f2fs", "zfs", "overlay"})
"""File systems on disks of one machine, which no other one writes to at the same time, unless this one serves them."""


@dataclass(frozen=True)
class Machine:
    """A machine by its name and identity, its boot, and the namespace of its process numbers, each as a digest.

    identity: "" where it is not known.
    """

    identity: str
    boot: str
    namespace: str

    @classmethod
    def here(cls) -> "Machine":
        """That of this process."""
        return _here()

    @classmethod
    def of(cls, text: str) -> "Machine":
        """The machine of a text; one that is no other's for a text of an earlier version."""
        identity, _, rest = text.partition(".")
        boot, _, namespace = rest.partition(".")
        return cls(identity, boot, namespace)

    def __str__(self) -> str:
        return f"{self.identity}.{self.boot}.{self.namespace}"

    def has_booted_since(self, folder: Path) -> bool:
        """Whether this machine's processes that worked in a folder ended with an earlier boot of the one here.

        Names and identities are copied with a machine: only on its own disks can nobody else be at work.
        """
        here = Machine.here()
        same = bool(self.identity and self.boot and here.boot) and self.identity == here.identity
        return same and self.boot != here.boot and is_local(folder)


def is_local(folder: Path) -> bool:
    """Whether a folder lies on a disk of this machine; False where that is not known."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        device = folder.stat().st_dev
        number = f"{os.major(device)}:{os.minor(device)}"
        for line in Path(MOUNTS).read_text(encoding="utf-8", errors="replace").splitlines():
            mount, _, source = line.partition(" - ")
            if mount.split()[2] == number:
                return source.split()[0] in LOCAL
    return False


@cache
def _here() -> Machine:
    boot, identity, namespace = "", "", ""
    with contextlib.suppress(OSError):
        boot = Path(BOOT).read_text(encoding="ascii")
    with contextlib.suppress(OSError, ValueError):
        identity = Path(IDENTITY).read_text(encoding="ascii").strip()
    with contextlib.suppress(OSError):
        namespace = str(Path(NAMESPACE).readlink())
    return Machine(
        _digest(socket.gethostname(), identity) if identity else "",
        _digest(boot) if boot else "",
        _digest(socket.gethostname(), boot, namespace),
    )


def _digest(*parts: str) -> str:
    return hashlib.sha256("|".join(parts).encode()).hexdigest()[:16]
