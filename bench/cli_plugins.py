"""The commands about what can be named in a suite: list, schema, check, peers."""

import sys
from pathlib import Path

import click


@click.command("list")
def list_command() -> None:
    """Show the suites and every plug-in by kind."""
    from bench.inventory import inventory

    click.echo(inventory())


@click.command("schema")
def schema_command() -> None:
    """Print the JSON Schema of a suite's TOML file, for editors."""
    from bench.verbs import schema

    click.echo(schema())


@click.command("check")
@click.argument("tracker", type=click.Path(path_type=Path))
@click.option("--keep", type=click.Path(path_type=Path), default=Path("out/check"), help="Folder of a faulty job.")
@click.option("--isolate", is_flag=True, help="Let the program see only its job folder.")
def check_command(tracker: Path, keep: Path, isolate: bool) -> None:
    """Try TRACKER, a TOML file with the table of one tracker, on a tiny sequence; explain every fault."""
    from bench.check import check
    from bench.config import load_tracker
    from bench.external import isolated_trackers
    from bench.external_job import KEPT_MARKER
    from trajectories.files import refuse_foreign

    refuse_foreign(keep, KEPT_MARKER)
    line, one = "", load_tracker(tracker)
    for line in check(isolated_trackers({"tracker": one})["tracker"] if isolate else one, keep):
        click.echo(line)
    sys.exit(1 if line.startswith("faulty") else 0)


@click.command("warm-up")
def warm_up_command() -> None:
    """Compile the kernels of trackers and flights now, which the first command would wait for otherwise."""
    from bench.plugins import PLUGINS  # so that every module with kernels is there
    from trajectories.warm_up import kernels_of, prepare

    prepare("bench.plugins")
    click.echo(f"{len(kernels_of(['bench.plugins']))} kernels for {len(PLUGINS)} kinds of plug-ins are compiled")


@click.group("peers")
def peers_group() -> None:
    """Trackers of others to compare with: ViSP's, and OpenCV contrib's."""


@peers_group.command("list")
def peers_list_command() -> None:
    """Show which peers are set up."""
    from bench.peers.registry import status

    click.echo("\n".join(status()))


@peers_group.command("setup")
@click.argument("name")
def peers_setup_command(name: str) -> None:
    """Set up the peer NAME, with what it needs, for this user."""
    from bench.peers.registry import setup

    click.echo(setup(name))


COMMANDS: tuple[click.Command, ...] = (
    list_command,
    schema_command,
    check_command,
    warm_up_command,
    peers_group,
)
