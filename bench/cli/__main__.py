"""Entry point of the command `uavbench`."""

import signal
import sys
from contextlib import suppress

from uavbench.trajectories.processes.standard_streams import forgive_lost_output


def main() -> None:
    """Run the command; an interrupt during the imports ends it without a traceback.

    A command does its work whether or not its output can be written. Where some of it could not, it says so on standard
    error, and does not end with exit code 0.
    """
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    output = forgive_lost_output()
    from uavbench.bench.cli.main import code_of_lost_output
    from uavbench.bench.cli.main import main as command

    signal.signal(signal.SIGINT, handler)
    try:
        command()
    except SystemExit as ended:
        with suppress(OSError, ValueError):  # of a stream that something else put in its place
            sys.stdout.flush()
        if output is not None and output.lost is not None:
            ended.code = ended.code or code_of_lost_output(output.lost)
        raise


if __name__ == "__main__":
    main()
