"""The output folder of a suite: claimed by name, used by one process at a time."""

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.config import Suite
from bench.jobs import clean_leftovers
from bench.shard import Shard
from trajectories.errors import UserError
from trajectories.files import write_text


@contextmanager
def suite_folder(folder: Path, suite: Suite, shard: Shard | None = None) -> Iterator[Path]:
    """The folder, made or taken up again; UserError when it holds something else or is in use.

    Shards of a suite may be at work in one folder at the same time, each once; nothing else may.
    """
    marker = folder / "suite.json"
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: not a folder; name another one with --out")
    if (
        folder.exists()
        and not marker.exists()
        and any(not p.name.startswith(".lock") and p.name != "slurm" for p in folder.iterdir())
    ):
        raise UserError(f"{folder}: holds something other than uavbench's output; name a new folder with --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / ".lock").open("w")
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror}; name another folder with --out") from None
    own = (folder / (".lock" if shard is None else f".lock_{shard.number}_of_{shard.count}")).open("w")
    with lock, own:
        try:
            fcntl.flock(lock, (fcntl.LOCK_EX if shard is None else fcntl.LOCK_SH) | fcntl.LOCK_NB)
            if shard is not None:
                fcntl.flock(own, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UserError(
                f"{folder}: another uavbench is at work in it; wait for it or name another folder"
            ) from None
        clean_leftovers(folder, ("*",) if shard is None else [spec.name for spec in shard.of(suite).sequences])
        about = {
            "suite": suite.name,
            "title": suite.title,
            "sequences": [spec.name for spec in suite.sequences],
            "trackers": list(suite.trackers),
            "rates_hz": list(suite.rates_hz),
            "flights": suite.flights,
        }
        write_text(marker, json.dumps(about, indent=1) + "\n")
        yield folder
