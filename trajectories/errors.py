"""The one exception that a user's mistake raises, and the errors of a disk that are told like one."""

import errno

_NAMES = "ENOSPC EDQUOT EFBIG EROFS EACCES EPERM ENAMETOOLONG EISDIR ENOTDIR ELOOP EEXIST"
DISK_ERRORS = frozenset(number for number, name in errno.errorcode.items() if name in _NAMES.split())
"""Of a disk that is full, read-only or not this user's, and of a name that it cannot have."""


class UserError(Exception):
    """A mistake in what the user gave: names the file, key or frame, what is wrong, and what to do.

    The command line prints its message without a traceback and exits with code 2.
    """


def unknown_name(what: str, name: str, valid: list[str]) -> UserError:
    """Error for a name that is not among the valid ones; says the nearest valid name."""
    import difflib

    near = difflib.get_close_matches(name, valid, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return UserError(f"unknown {what} {name!r}{hint} (valid: {', '.join(sorted(valid))})")


def told_of_disk(error: OSError) -> str:
    """An error of the disk in words: the file, what is wrong, what to do."""
    return f"{error.filename or 'the disk'}: {error.strerror or error}; free space, or name another place"
