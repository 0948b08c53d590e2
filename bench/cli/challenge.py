"""The commands of a challenge: pack."""

import sys
from pathlib import Path

import click

from uavbench.bench.cli.cores import jobs_option
from uavbench.trajectories.errors import UserError

FILE = click.Path(path_type=Path)


@click.command("pack")
@click.argument("suite")
@click.option("--without-truth", is_flag=True, help="Keep ground truth and seeds back; a package is always made so.")
@click.option("--out", type=FILE, required=True, help="Folder for the participants.")
@click.option("--truth", type=FILE, help="Folder of the organizer alone; default: out/SUITE-truth.")
@click.option("--secret", type=FILE, help="File of the secret, made where there is none; default: in --truth.")
@click.option(
    "--private-suite", is_flag=True, help="No participant will see SUITE's file: its paths may be without chance."
)
@jobs_option()
def pack_command(
    suite: str, without_truth: bool, out: Path, truth: Path | None, secret: Path | None, private_suite: bool, jobs: int
) -> None:
    """Write a package of SUITE for the participants of a challenge, rendered under a secret."""
    from uavbench.bench.challenge.pack import Packing, pack

    if not without_truth:
        raise UserError(
            "pack writes what participants of a challenge get: say --without-truth; `uavbench render` writes sequences "
            "with their ground truth"
        )
    kept = truth or Path("out") / f"{Path(suite).stem}-truth"
    where = Packing(out=out, truth=kept, secret=secret, private_suite=private_suite, workers=jobs)
    sys.exit(pack(suite, where))


COMMANDS: tuple[click.Command, ...] = (pack_command,)
