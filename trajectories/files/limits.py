"""Size limits on untrusted files, in one place, each with its unit and reason.

They are far above what real data need, and are checked before memory is allocated.
"""

from dataclasses import dataclass

MB = 1 << 20


@dataclass(frozen=True)
class FileLimit:
    """Size limit of one kind of file in bytes, and the remedy for a larger file."""

    kind: str
    most_bytes: int
    remedy: str


SETTINGS = FileLimit("settings file", 4 * MB, "is it the right file?")
"""Suites, trackers, cameras, initial poses, airframes, baselines: the longest of ours has 0.1 MB."""
JSON = FileLimit("JSON file", 256 * MB, "score fewer runs in one suite")
"""Scores of 1,000 runs are about 20 MB."""
TABLE = FileLimit("table", 256 * MB, "split the flight into shorter ones")
"""Two hours of a 200 Hz IMU are 200 MB."""
TRAJECTORY = FileLimit("trajectory", 1024 * MB, "split the trajectory into shorter ones")
"""MOST_POSES at 128 bytes each."""
MODEL = FileLimit("model", 512 * MB, "simplify the model to its planar faces")
"""MOST_TRIANGLES (uavbench.scenes.model_files.face_limits) as text, 250 bytes each."""
IMAGE = FileLimit("image", 512 * MB, "scale the image down")
"""MOST_PIXELS uncompressed, 3 bytes each."""
VIDEO = FileLimit("video", 65_536 * MB, "split the video into shorter ones")
"""Read image by image: an hour of 4K."""
BAG = FileLimit("bag", 65_536 * MB, "split the bag into shorter ones")
"""Read message by message, as a video; `ros2 bag record` splits at a size set by its user."""
ANY = FileLimit("file", 1_048_576 * MB, "is it the right file?")
"""Files that are only hashed."""

MOST_PIXELS = 160_000_000
"""Pixels of one image, or of all textures of a model: the largest aerial cameras have 151 million."""
BAG_METADATA = FileLimit("bag's metadata file", 1 * MB, "is it the right file?")
"""A hundred topics in a thousand files are 300 kB, and YAML is read slowly."""
MOST_CHUNK_BYTES = IMAGE.most_bytes
"""Decompressed size of simultaneous chunks of an MCAP file: writers close a chunk after 1 to 16 MB, or one image."""
MOST_MESSAGE_BYTES = 16 * MB
"""A message other than an image: 200,000 transforms, or the point cloud of one lidar revolution."""
MOST_POSES = 8_000_000
"""Poses of one trajectory: eleven hours at 200 Hz, half a gigabyte as arrays."""
MOST_ROWS = 2_000_000
"""Rows of one table: two and a half hours of a 200 Hz IMU."""
LONGEST_LINE = 16_384
"""Bytes of one line of numbers: an EuRoC row has 17 numbers, a claimed covariance 28, none of more than 32 bytes."""
MOST_NESTING = 64
"""Nesting depth of a TOML or JSON file: the deepest of ours has 8."""
LARGEST_COORDINATE_M = 1e12
"""Largest coordinate in metres; beyond it float64 does not resolve 0.1 mm."""
