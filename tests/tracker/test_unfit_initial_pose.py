"""Where no frame has a pose, `track` tells what may be wrong with the initial one, as that it is the inverse."""

import cv2
import numpy as np
import pytest

from tests.bench.small_suites import TRIAL
from tests.tracker.synthetic import CAMERA, Scene, box, box_corners
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.images.overlay import share_on_edges
from uavbench.tracker.images.track_images import track_images
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose

DOWN = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""Camera axes that look down: of such poses the inverse looks down, too, and the model may be in the image at both."""


class Lost:
    """A tracker that is lost, or ambiguous, in all frames."""

    def __init__(self, status):
        self.status = status

    def start(self, structure, camera, cam_from_world, rng):
        return self

    def track(self, image, stamp_ns):
        return TrackResult(status=self.status)


def from_above(number, turn_rad=0.5):
    """cam_from_world of a camera 1.2 m above the ground, beside the box's middle."""
    turned = Pose.exp(np.array([0, 0, 0, 0, 0, turn_rad]))
    return DOWN @ turned @ Pose(np.eye(3), -np.array([0.12 + 0.005 * number, 0.05, 1.2]))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Images from above, camera and model."""
    folder = tmp_path_factory.mktemp("above")
    (folder / "images").mkdir()
    scene, rng = Scene([box_corners()], seed=7), np.random.default_rng(7)
    for number in range(4):
        cv2.imwrite(str(folder / f"images/{number}.png"), scene.render(from_above(number), noise_rng=rng))
    CAMERA.save(folder / "camera.toml")
    corners, faces = box().vertices, box().triangles + 1
    rows = [f"v {x} {y} {z}" for x, y, z in corners.tolist()] + [f"f {a} {b} {c}" for a, b, c in faces.tolist()]
    (folder / "model.obj").write_text("\n".join(rows) + "\n")
    return folder


def told(files, folder, pose, status="lost"):
    (folder / "init.toml").write_text(f"cam_from_model = {pose.matrix.tolist()}\n")
    given = {"model": files / "model.obj", "camera": files / "camera.toml", "init": folder / "init.toml"}
    results = track_images(Lost(status), files / "images", **given, out=folder / "out")
    return [doubt for doubt in results.record["doubts"] if "no frame has a pose" in doubt]


def test_the_inverse_of_the_pose_is_told(files, tmp_path):
    (said,) = told(files, tmp_path, from_above(0).inverse())
    assert "init.toml" in said and "is it world_from_cam in place of cam_from_model? Give the inverse" in said


def test_another_pose_is_told_with_what_may_be_wrong(files, tmp_path):
    (said,) = told(files, tmp_path, Pose.exp(np.array([0.15, -0.1, 0.2, 0, 0, 0])) @ from_above(0, turn_rad=1.1))
    assert "is it the pose of this image, are camera and model those of these images" in said


@pytest.mark.parametrize("status", ["lost", "ambiguous"])
def test_a_right_pose_is_not_doubted(files, tmp_path, status):
    assert told(files, tmp_path, from_above(0), status) == []


def test_the_model_lies_on_edges_of_a_rendered_image_at_its_true_pose():
    sequence = Sequence.load(TRIAL)
    image, pose = sequence.image(0), sequence.true_cam_from_world(0)
    beside = Pose.exp(np.array([0.05, 0, 0, 0.05, 0, 0])) @ pose
    at = [share_on_edges(image, sequence.structure, sequence.camera, each) for each in (pose, beside, pose.inverse())]
    assert at[0] > 0.7 and at[1] < 0.3 and at[2] == 0.0
