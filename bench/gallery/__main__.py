"""`python -m uavbench.bench.gallery DIR`."""

from pathlib import Path

import click

from uavbench.bench.gallery.page import write_gallery


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
def main(folder: Path) -> None:
    """Write gallery.md, and its pictures beside it, into FOLDER."""
    write_gallery(folder)


if __name__ == "__main__":
    main()
