"""Whether the model is where images show it, at poses of one's own or at the same in another convention."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.image_files import read_image
from uavbench.tracker.images.overlay import share_on_edges
from uavbench.tracker.images.recorded_sequence import Recording
from uavbench.tracker.images.track_images import BETTER_PLACED, WELL_PLACED
from uavbench.tracker.initialization import LEAST_SPAN_PX, span_px
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory

MOST_IN_VIEW, MOST_ON_EDGES = 60, 8
"""Images, evenly spread, in which the model is looked for, and with whose edges its own are compared."""
MISPLACED = 0.3
"""Share of the model's edges on edges of the images below which poses are doubted by themselves.

At the true poses of 46 rendered flights it is 0.37 (behind people) to 0.96.
"""
TURNED, WAYS = 0.02, 8
"""Part of the image's diagonal by which the model is moved in the image, to compare poses, and in how many ways."""
LEAST_LEAD = 0.05
"""By how much larger that share must be at the given poses than in the best of these places.

At the true poses of 49 rendered flights it is larger by 0.08 (in much noise, where all is edges) to 0.64.
"""
HALF_TURN = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""About the camera's x axis: between the axes of OpenGL (y up, z backward) and of OpenCV."""
FORWARD = Pose(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.zeros(3))
"""`cam_from_body` of a camera that looks along the body's x axis, with z up."""
Z_UP = Pose(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), np.zeros(3))
"""From a world with y up to one with z up, as models of glTF are turned."""


def _with_order(pose: Pose, order: list[int]) -> Pose:
    """The pose whose quaternion wxyz has these numbers of the given one."""
    return Pose.from_quaternion(pose.quaternion_wxyz[order], pose.translation)


CONVENTIONS: dict[str, Callable[[Pose, Pose], Pose]] = {
    "at their inverses (cam_from_world in place of world_from_cam)": lambda pose, cam: cam @ pose,
    "with a camera as in OpenGL and Blender (y up, z backward)": lambda pose, cam: HALF_TURN @ cam @ pose.inverse(),
    "at their inverses, with a camera as in OpenGL (y up, z backward)": lambda pose, cam: HALF_TURN @ cam @ pose,
    "with positions in millimetres": lambda pose, cam: cam @ Pose(pose.rotation, pose.translation / 1000).inverse(),
    "with a model in metres, as the poses, in place of millimetres": lambda pose, cam: (
        cam @ Pose(pose.rotation, 1000 * pose.translation).inverse()
    ),
    "with w first in the quaternions": lambda pose, cam: cam @ _with_order(pose, [1, 2, 3, 0]).inverse(),
    "with w last in the quaternions": lambda pose, cam: cam @ _with_order(pose, [3, 0, 1, 2]).inverse(),
    "with y up in the world, as in glTF": lambda pose, cam: cam @ (Z_UP @ pose).inverse(),
    "with the inverse of cam_from_body": lambda pose, cam: cam.inverse() @ pose.inverse(),
    "as poses of a body (x forward, z up), whose cam_from_body is missing": lambda pose, _: FORWARD @ pose.inverse(),
}
"""How else poses may be meant: cam_from_world of a pose `world_from_moving` and of `cam_from_moving`."""


class Seen(NamedTuple):
    """A recording with the pose of what moves at each image, and of the camera on it."""

    recording: Recording
    world_from_moving: Trajectory
    cam_from_moving: Pose

    def cam_from_world(self, frame: int, meant: Callable[[Pose, Pose], Pose] | None = None) -> Pose:
        """Pose of the camera at an image, as it is given or as it may be meant."""
        pose = self.world_from_moving.pose(frame)
        return meant(pose, self.cam_from_moving) if meant else self.cam_from_moving @ pose.inverse()

    def in_view(self, frame: int) -> bool:
        """Whether an image would show the model."""
        structure, camera = self.recording.structure, self.recording.camera
        return span_px(structure, camera, self.cam_from_world(frame)) >= LEAST_SPAN_PX

    def spread(self, most: int) -> list[int]:
        """At most so many images, evenly spread, the first one first."""
        n = len(self.recording.images)
        return [int(frame) for frame in np.unique(np.linspace(0, n - 1, min(n, most)).round())]


def check_in_view(name: str, seen: Seen) -> None:
    """UserError where the first image does not show the model, with the convention in which it would."""
    if seen.in_view(0):
        return
    frames, images = seen.spread(MOST_IN_VIEW), seen.recording.images
    shown = [frame for frame in frames if seen.in_view(frame)]
    head = f"{name}: at these poses the model is in {len(shown)} of {len(frames)} images"
    asked = "give world_from_cam in the model's frame: metres, the camera's x right, y down, z forward"
    if better := _better(seen, _on_edges(seen)):
        raise UserError(f"{head}, and {better} of its edges lie on edges of the images; {asked}")
    if shown:
        raise UserError(
            f"{head}, but not in {images[0].name}; leave out the images before {images[shown[0]].name}, since trackers "
            "begin with the first one"
        )
    raise UserError(f"{head}; {asked}, origin and axes of the world those of the model file")


def doubts_of_edges(name: str, seen: Seen) -> list[str]:
    """Message on poses at which the model's edges do not lie on those of the images, as they may in another way."""
    given = _on_edges(seen)
    head = f"{name}: at these poses {100 * given:.0f} % of the model's edges lie on edges of the images"
    if given < WELL_PLACED and (better := _better(seen, given)):
        return [f"{head}, and {better}: correct the poses"]
    beside = max(_on_edges(seen, meant) for meant in _turned(seen.recording.camera))
    if given >= MISPLACED and given >= beside + LEAST_LEAD:
        return []
    return [
        f"{head}, and {100 * beside:.0f} % with the camera turned by {100 * TURNED:g} % of the image's diagonal: are "
        "stamps, camera and model those of these images, and has each image its own pose? All errors are against these "
        "poses"
    ]


def _turned(camera: Camera) -> list[Callable[[Pose, Pose], Pose]]:
    """Poses with the camera turned by a few pixels, in each of WAYS directions."""
    angle = TURNED * float(np.hypot(camera.width / camera.fx, camera.height / camera.fy))
    ways = 2 * np.pi * np.arange(WAYS) / WAYS
    turns = [Pose.exp(np.array([0.0, 0.0, 0.0, angle * np.cos(way), angle * np.sin(way), 0.0])) for way in ways]
    return [partial(_with_camera, turn) for turn in turns]


def _with_camera(turn: Pose, pose: Pose, cam: Pose) -> Pose:
    return turn @ cam @ pose.inverse()


def _better(seen: Seen, given: float) -> str:
    """The convention in which most of the model's edges lie on the images', and their share; "" if none is better."""
    shares = {how: _on_edges(seen, meant) for how, meant in CONVENTIONS.items()}
    best = max(shares, key=shares.__getitem__)
    fits = shares[best] > max(WELL_PLACED, given + BETTER_PLACED)
    return f"{best} {100 * shares[best]:.0f} %" if fits else ""


def _on_edges(seen: Seen, meant: Callable[[Pose, Pose], Pose] | None = None) -> float:
    """Median over some images of the share of the model's edges that lie on edges of the image."""
    images, camera, structure = seen.recording.images, seen.recording.camera, seen.recording.structure
    shares = [
        share_on_edges(read_image(images[frame], camera), structure, camera, seen.cam_from_world(frame, meant))
        for frame in seen.spread(MOST_ON_EDGES)
    ]
    return float(np.median(shares))
