"""Output of commands, with control characters escaped."""

import click

from uavbench.trajectories.errors import plain


def say(what: object = "", *, err: bool = False, nl: bool = True) -> None:
    """Print a text or a path on standard output, or on standard error, with control characters escaped."""
    click.echo(plain(str(what)), err=err, nl=nl)
