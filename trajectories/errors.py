"""UserError, the exception for user errors, and DiskError; escaping of untrusted text; messages for disk errors."""

import errno
import json
import re
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, get_args

_NAMES = "ENOSPC EDQUOT EFBIG EIO ESTALE EROFS EACCES EPERM ENAMETOOLONG EISDIR ENOTDIR ELOOP EEXIST"
DISK_ERRORS = frozenset(number for number, name in errno.errorcode.items() if name in _NAMES.split())
"""Errors of a full, broken or read-only disk, of missing permissions, and of invalid names."""
NO_SPACE = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG))
"""Those of them that free space mends; a file is too large where a quota or a file system limits it."""
FULL_OR_BROKEN = NO_SPACE | frozenset((errno.EIO, errno.ESTALE))
"""Those of them that are no mistake in the input: the same command may succeed later, or once there is space."""
UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters C0 and C1 except tab and line feed, and Unicode's bidirectional marks."""


def plain(text: str) -> str:
    """Text with escaped control characters (ESC as a backslash and x1b), safe on a terminal and on a page."""
    return UNSEEN.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


def one_line(text: str) -> str:
    """Escaped text on one line, without tabs."""
    return " ".join(plain(text).split())


class Terminated(SystemExit):
    """The process was terminated by a signal, unlike a SystemExit raised by a plug-in, which is a fault."""


class UserError(Exception):
    """Invalid input by the user; the message names the file, key or frame, the defect, and the remedy.

    The command line prints its message without a traceback and exits with code 2 (DiskError: 1). The message is plain
    text.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(plain(message))


class DamagedFileError(UserError):
    """A file is not as uavbench wrote it. Whoever can do without a missing file must not do without this one."""


class DiskError(UserError):
    """A disk is full or broken, which is no mistake in the input: as after a failed job the exit code is 1."""

    @classmethod
    def of(cls, error: OSError, message: str = "") -> UserError:
        """The error to raise for a disk error: this one if the disk is full or broken, else a UserError."""
        kind = cls if error.errno in FULL_OR_BROKEN else UserError
        return kind(message or disk_error_message(error))


def refuse_other(key: str, value: object, choices: Any) -> None:
    """UserError for the value of an option that is not one of a Literal's `choices`."""
    valid = list(get_args(choices))
    if value not in valid:
        raise unknown_name(key, str(value), valid)


def refuse_idle(spec: Any, needs: Mapping[str, tuple[str, ...]]) -> None:
    """UserError for a key of a spec that is not its default and changes nothing.

    needs: by key those of which at least one must not be 0, false or none for it to have an effect.
    """
    usual = {each.name: each.default for each in fields(spec)}
    for key, others in needs.items():
        if getattr(spec, key) != usual[key] and not any(getattr(spec, other) for other in others):
            off = " and ".join(f"{other} is {json.dumps(getattr(spec, other))}" for other in others)
            raise UserError(
                f"{key} {getattr(spec, key):g} has no effect: {off}; give {' or '.join(others)}, or leave {key} out"
            )


def unknown_name(what: str, name: str, valid: list[str]) -> UserError:
    """Error for an unknown name; suggests the closest valid one."""
    import difflib

    near = difflib.get_close_matches(name, valid, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return UserError(f"unknown {what} {name!r}{hint} (valid: {', '.join(sorted(valid))})")


def disk_error_message(error: OSError) -> str:
    """Message for a disk error: the file, the cause, the remedy."""
    advice = "free space, or choose another location" if error.errno in NO_SPACE else "choose another location"
    return f"{error.filename or 'the disk'}: {error.strerror or error}; {advice}"
