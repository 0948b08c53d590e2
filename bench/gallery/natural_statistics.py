"""Natural-scene statistics of images, to compare rendered frames with photographs.

`python -m uavbench.bench.gallery.natural_statistics FILE...` prints a row of Markdown for each file.
"""

from dataclasses import dataclass
from pathlib import Path

import click
import cv2
import numpy as np

from uavbench.bench.said import say
from uavbench.scenes.image_files import load_image
from uavbench.scenes.rendering.radiance import LIGHT, decode
from uavbench.tracker.protocol import Image
from uavbench.trajectories.pose import Array

FITTED = (8, 4)
"""Band of the slope fit: from 8 periods per shorter side of the image to 4 pixels per period. Lower frequencies depend
on window and layout, higher ones on antialiasing."""
BINS = 20


@dataclass(frozen=True)
class NaturalStatistics:
    """Statistics of one image's luminance.

    slope: of log power over log frequency; gradient_kurtosis: of differences of log luminance between horizontal
    neighbours, 3 for a normal distribution; log_deviation: standard deviation of the natural log of luminance.
    """

    slope: float
    gradient_kurtosis: float
    log_deviation: float

    @classmethod
    def of(cls, image: Image) -> "NaturalStatistics":
        """Statistics of a finished image (h, w, 3) uint8, BGR, sRGB."""
        light = cv2.cvtColor(decode(image), cv2.COLOR_BGR2GRAY).astype(np.float64)
        log = np.log(np.maximum(light, LIGHT[1]))  # the darkest code that is not black
        steps = np.diff(log, axis=1)
        return cls(spectrum_slope(light), kurtosis(steps), float(log.std()))


def spectrum_slope(light: Array) -> float:
    """Slope of log power over log frequency of a linear image (h, w), power averaged over directions."""
    h, w = light.shape
    window = np.outer(np.hanning(h), np.hanning(w))
    power = np.abs(np.fft.fft2((light - np.average(light, weights=window)) * window)) ** 2
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(h), np.fft.fftfreq(w), indexing="ij"))
    edges = np.geomspace(FITTED[0] / min(h, w), 1 / FITTED[1], BINS + 1)
    which = np.digitize(frequency, edges)
    inner = range(1, BINS + 1)
    means = np.array([power[which == k].mean() for k in inner])
    middles = np.array([np.log(frequency[which == k]).mean() for k in inner])
    return float(np.polyfit(middles, np.log(means), 1)[0])


def kurtosis(values: Array) -> float:
    """Fourth central moment over the squared variance of an array: 3 for a normal distribution."""
    centred = values - values.mean()
    return float((centred**4).mean() / (centred**2).mean() ** 2)


@click.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
def main(files: tuple[Path, ...]) -> None:
    """Print the statistics of images."""
    say("| image | slope | kurtosis | deviation |\n|---|---|---|---|")
    for file in files:
        found = NaturalStatistics.of(load_image(file))
        say(f"| {file.stem} | {found.slope:.2f} | {found.gradient_kurtosis:.0f} | {found.log_deviation:.2f} |")


if __name__ == "__main__":
    main()
