"""Processes that code of a user forks: none goes on in ours."""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def ending_what_forked_off() -> Iterator[None]:
    """Context for a call of a user's code: a process that was forked in it ends with it, its exit code as of a script.

    It would go on as a second copy of this one, write the same files, and take what others send to this one.
    """
    own = os.getpid()
    try:
        yield
    except BaseException as error:
        if os.getpid() != own:
            os._exit(_exit_code(error))
        raise
    if os.getpid() != own:
        os._exit(0)


def _exit_code(error: BaseException) -> int:
    code = error.code if isinstance(error, SystemExit) else 1
    return code if isinstance(code, int) else int(code is not None)
