"""The command `uavbench`: its groups of subcommands, signals and error messages."""

import errno
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from uavbench.bench.cli import challenge as cli_challenge
from uavbench.bench.cli import files as cli_files
from uavbench.bench.cli import gate as cli_gate
from uavbench.bench.cli import plugins as cli_plugins
from uavbench.bench.cli import scans as cli_scans
from uavbench.bench.cli import suite as cli_suite
from uavbench.bench.cli.environment import settle_environment
from uavbench.bench.said import say
from uavbench.trajectories.errors import DISK_ERRORS, DiskError, UserError
from uavbench.trajectories.lost_signals import lost_signals_raised_again, raise_until_handled

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


PUT_IN_ORDER_S = 15.0
"""Time in s for stopping processes and removing incomplete files, during which further signals are ignored."""


@contextmanager
def interrupts() -> Iterator[None]:
    """Context in which termination signals raise KeyboardInterrupt, except while an earlier one is being handled."""
    last_s = -PUT_IN_ORDER_S

    def interrupt(*_: Any) -> None:
        nonlocal last_s
        if time.monotonic() - last_s >= PUT_IN_ORDER_S:
            last_s = time.monotonic()
            raise_until_handled(KeyboardInterrupt())

    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in SIGNALS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:  # ignored under nohup
            signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


VERDICTS = frozenset(("check", "verify", "gate", "compare", "history", "speed"))
"""Commands whose exit code 1 is a verdict, which a full disk is not."""


def told(error: UserError, command: str | None) -> int:
    """Print the message of an error that ended a command; the exit code."""
    say(f"uavbench: {error}", err=True)
    return 1 if isinstance(error, DiskError) and command not in VERDICTS else 2


def code_of_lost_output(error: OSError) -> int:
    """Say that standard output was not written, unless its reader has left; the exit code in place of 0."""
    command = next((word for word in sys.argv[1:] if word in main.commands), None)
    if error.errno == errno.EPIPE:
        return 2 if command in VERDICTS else 1
    why = error.strerror or str(error)
    return told(DiskError(f"standard output: {why}; what the command prints is lost, its files are not"), command)


def no_working_folder() -> UserError | None:
    """Error where the current folder was removed, as by a clean checkout: no relative path means anything there."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return UserError("the current folder has been removed; change into another one, or into it again")
    return None


class Group(click.Group):
    """Prints user errors and I/O errors as one message, without a traceback.

    The exit code is 2 for a mistake in the input; for a full or broken disk 1, or 2 of VERDICTS.
    """

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the subcommands with their whole summaries, which click cuts to one line."""
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, self.commands[name].get_short_help_str(sys.maxsize)) for name in sorted(self.commands)]
            )

    def invoke(self, ctx: click.Context) -> Any:
        """Run the given subcommand."""
        try:
            with lost_signals_raised_again(), interrupts():
                if gone := no_working_folder():
                    raise gone
                settle_environment()
                return super().invoke(ctx)
        except UserError as error:
            ctx.exit(told(error, ctx.invoked_subcommand))
        except OSError as error:
            if error.errno == errno.ENOENT and (gone := no_working_folder()):
                ctx.exit(told(gone, ctx.invoked_subcommand))
            if error.errno not in DISK_ERRORS:
                raise
            ctx.exit(told(DiskError.of(error), ctx.invoked_subcommand))
        except KeyboardInterrupt as error:
            notes = getattr(error, "__notes__", ["run the same command again"])
            say(f"uavbench: interrupted; {'; '.join(notes)}", err=True)
            ctx.exit(130)


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="uavbench")
def main() -> None:
    """Ground truth for model-based UAV localization: render flights, run trackers, score, report."""


for group in (cli_suite, cli_files, cli_scans, cli_challenge, cli_gate, cli_plugins):
    for command in group.COMMANDS:
        main.add_command(command)


if __name__ == "__main__":
    main()
