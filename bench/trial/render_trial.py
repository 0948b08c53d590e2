"""Render the tiny sequence that `uavbench check` runs: `python -m uavbench.bench.trial.render_trial`."""

import shutil
import tempfile
from pathlib import Path

import cv2

from uavbench.bench.config.suite import load_suite
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.verify import write_manifest
from uavbench.scenes.generate import generate
from uavbench.scenes.spec import SequenceSpec


def main() -> None:
    """Render bench/trial/sequence again, its images at PNG's highest compression."""
    (spec,) = load_suite(TRIAL.parent / "suite.toml").sequences
    assert isinstance(spec, SequenceSpec)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "sequence"
        generate(spec, folder, content_hash=content_hash(spec))
        sequence = Sequence.load(folder)
        for frame, name in enumerate(sequence.files):
            cv2.imwrite(str(folder / name), sequence.image(frame), [cv2.IMWRITE_PNG_COMPRESSION, 9])
        write_manifest(folder)
        shutil.rmtree(TRIAL, ignore_errors=True)
        shutil.copytree(folder, TRIAL)


if __name__ == "__main__":
    main()
