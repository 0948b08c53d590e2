"""Start a program under limits: `python -I -S external_launch.py MEMORY_MB COMMAND...`.

Run in the child before the program takes its place, so that the limits hold from its first instruction on.
"""

import contextlib
import ctypes
import os
import resource
import signal
import sys

MAX_FILE_MB = 1024
PR_SET_PDEATHSIG = 1


def main() -> None:
    """Set the limits on memory, files and core dumps, bind its life to the harness's, and become the program."""
    memory = int(sys.argv[1]) << 20
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_FSIZE, (MAX_FILE_MB << 20, MAX_FILE_MB << 20))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(OSError, AttributeError):  # where there is no prctl, the program ends when its input does
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    try:
        os.execvp(sys.argv[2], sys.argv[2:])
    except OSError as error:
        print(f"{sys.argv[2]}: {error.strerror}", file=sys.stderr)
        sys.exit(127)


if __name__ == "__main__":
    main()
