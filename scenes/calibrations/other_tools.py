"""Which tool's calibration a file is, by its content, and how its numbers become those of a `camera.toml`."""

import re
from typing import NamedTuple

SUFFIXES = (".yaml", ".yml", ".json", ".xml", ".txt", ".bin", ".ini", ".npz", ".npy", ".gz")
"""Suffixes of the files of OpenCV, Kalibr, ROS, COLMAP and others."""
KEYS = "width, height, fx, fy, cx, cy, distortion_model and distortion"
OURS = re.compile(rb"^[ \t]*(?:width|height|f[xy]|c[xy])[ \t]*=", re.MULTILINE)
"""A line of a `camera.toml`, whose mistake is another one."""
COLMAP = (
    "cx and cy less 0.5, since the first pixel's centre is (0.5, 0.5) there; OPENCV is radtan with its k1, k2, p1, p2, "
    "SIMPLE_RADIAL radtan with [k, 0, 0, 0] and fx = fy = f, OPENCV_FISHEYE equidistant"
)


class Tool(NamedTuple):
    """A tool: what its files hold, in the order in which they are tried, its name, and what to write."""

    holds: re.Pattern[bytes]
    name: str
    advice: str


TOOLS = (
    Tool(
        re.compile(rb"^[ \t]*\d+[ \t]+(?:\w*(?:PINHOLE|RADIAL|OPENCV|FISHEYE)|FOV)[ \t]+\d+[ \t]+\d+\s", re.MULTILINE),
        "a model of COLMAP", COLMAP,
    ),
    Tool(
        re.compile(rb'"fl_x"\s*:'),
        "a dataset of nerfstudio", f"fx and fy are fl_x and fl_y; {COLMAP}",
    ),
    Tool(
        re.compile(rb"distortion_coeffs\b|\bT_cam_imu\b|\bT_cn_cnm1\b"),
        "a chain of Kalibr",
        "of one camera: fx, fy, cx, cy are `intrinsics` of a pinhole, radtan and equidistant (equi) are those here; "
        "omni, ds, eucm and fov are not known: calibrate with pinhole-radtan or pinhole-equi",
    ),
    Tool(
        re.compile(rb"narrow_stereo|\brectification_matrix\b|\bplumb_bob\b|\brational_polynomial\b|\bbinning_x\b"),
        "a calibration of ROS",
        "fx, fy, cx, cy of camera_matrix (K); plumb_bob is radtan, with the numbers of D as they are. "
        "projection_matrix (P) is of rectified images, whose distortion_model is none. Of rational_polynomial, "
        "calibrate again with plumb_bob",
    ),
    Tool(
        re.compile(rb"opencv[-_](?:matrix|storage)|^%YAML:1\.0|\btype_id\b", re.MULTILINE),
        "a file of OpenCV",
        "fx, cx, fy, cy of the rows fx 0 cx and 0 fy cy; the first 4 or 5 distortion coefficients are radtan, if all "
        "others are 0; those of cv2.fisheye are equidistant",
    ),
    Tool(
        re.compile(rb"\bdistortion_coefficients\s*:"),
        "a sensor of EuRoC",
        "fx, fy, cx, cy are `intrinsics`; radial-tangential is radtan, with its coefficients as they are",
    ),
)  # fmt: skip
OTHER_NAMES = {
    **dict.fromkeys(
        ("radtan", "plumbbob", "radialtangential", "brown", "brownconrady", "opencv", "radial", "simpleradial"),
        "radtan",
    ),
    **dict.fromkeys(
        ("equidistant", "equi", "fisheye", "opencvfisheye", "kannalabrandt", "kannalabrandt4", "kb", "kb4",
         "radialfisheye", "simpleradialfisheye"), "equidistant",
    ),
    **dict.fromkeys(("", "none", "pinhole", "simplepinhole", "perspective", "rectilinear"), "none"),
}  # fmt: skip
"""What ROS, EuRoC, OpenCV, COLMAP and others call a distortion model, in small letters alone, and its name here."""


def own_name(model: str) -> str:
    """Name here of a distortion model of another tool, "" for one that is not known."""
    return OTHER_NAMES.get(re.sub(r"[\W_]", "", model.lower()), "")


def advice_on(suffix: str, head: bytes) -> str:
    """What to do about a file with these first bytes and suffix; "" for one that is no calibration of another tool."""
    if OURS.search(head):
        return ""
    for tool in TOOLS:
        if tool.holds.search(head):
            return f"is {tool.name}, which is not read; write a camera.toml of its {KEYS}: {tool.advice}"
    if suffix == ".bin":
        return (
            "is not read; convert a binary model of COLMAP by `colmap model_converter --output_type TXT`, and write a "
            f"camera.toml of its {KEYS}: {COLMAP}"
        )
    if suffix in SUFFIXES:
        return f"calibrations of other tools are not read; write a camera.toml of its {KEYS}"
    return ""
