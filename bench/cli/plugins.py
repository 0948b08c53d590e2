"""The commands on plug-ins: list, schema, check, warm-up, third-party."""

import sys
from pathlib import Path

import click

from uavbench.bench.cli.values import FILE
from uavbench.bench.said import say


@click.command("list")
def list_command() -> None:
    """Show the suites and every plug-in by kind."""
    from uavbench.bench.config.inventory import inventory

    say(inventory())


@click.command("schema")
def schema_command() -> None:
    """Print the JSON Schema of a suite's TOML file, for editors."""
    from uavbench.bench.runner.commands import schema

    say(schema())


@click.command("check")
@click.argument("tracker", type=FILE)
@click.option("--keep", type=FILE, default=Path("out/check"), help="Folder of a faulty job.")
@click.option("--isolate", is_flag=True, help="Let the program see only its job folder.")
def check_command(tracker: Path, keep: Path, isolate: bool) -> None:
    """Try TRACKER, a TOML file with the table of one tracker, on a tiny sequence; explain every fault."""
    from uavbench.bench.config.suite import load_tracker
    from uavbench.bench.external.kept_folder import KEPT_MARKER
    from uavbench.bench.external.program import isolated_trackers
    from uavbench.bench.trial.apart import check_apart
    from uavbench.trajectories.files.origin import refuse_foreign

    refuse_foreign(keep, KEPT_MARKER)
    line, one = "", load_tracker(tracker)
    for line in check_apart(isolated_trackers({"tracker": one})["tracker"] if isolate else one, keep):
        say(line)
    sys.exit(1 if line.startswith("faulty") else 0)


@click.command("warm-up")
def warm_up_command() -> None:
    """Compile all kernels now, which the first command would wait for otherwise."""
    from uavbench.bench.closed_loop import fly
    from uavbench.bench.runner import tasks
    from uavbench.scenes.decoding import jpeg_damage
    from uavbench.scenes.png import encoder
    from uavbench.scenes.scans import planar_model  # with these five, every module with kernels is imported
    from uavbench.trajectories.kernels.warm_up import kernels_of, prepare

    modules = tuple(each.__name__ for each in (fly, tasks, jpeg_damage, encoder, planar_model))
    prepare(*modules)
    say(f"{len(kernels_of(modules))} kernels are compiled")


@click.group("third-party")
def third_party_group() -> None:
    """Third-party trackers as baselines: those of ViSP and OpenCV contrib."""


@third_party_group.command("list")
def third_party_list_command() -> None:
    """Show which third-party trackers are set up."""
    from uavbench.bench.third_party.registry import status

    say("\n".join(status()))


@third_party_group.command("setup")
@click.argument("name")
def third_party_setup_command(name: str) -> None:
    """Set up the tracker NAME and its dependencies for this user."""
    from uavbench.bench.third_party.registry import setup

    say(setup(name))


COMMANDS: tuple[click.Command, ...] = (
    list_command,
    schema_command,
    check_command,
    warm_up_command,
    third_party_group,
)
