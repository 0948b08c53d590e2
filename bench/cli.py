"""The command `uavbench`: every verb reads and writes files, and is short here."""

from typing import Any

import click

from bench import cli_files, cli_gate, cli_plugins, cli_suite
from bench.processes import interrupt_on_signals
from trajectories.errors import UserError


class Group(click.Group):
    """Prints a user's mistake as one message, without a traceback, and exits with code 2."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command that was asked for."""
        interrupt_on_signals()
        try:
            return super().invoke(ctx)
        except UserError as error:
            click.echo(f"uavbench: {error}", err=True)
            ctx.exit(2)
        except KeyboardInterrupt:
            click.echo("uavbench: interrupted; the same command goes on from here", err=True)
            ctx.exit(130)


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="uavbench")
def main() -> None:
    """Ground truth for model-based UAV localization: render flights, run trackers, score, report."""


for group in (cli_suite, cli_files, cli_gate, cli_plugins):
    for command in group.COMMANDS:
        main.add_command(command)


if __name__ == "__main__":
    main()
