"""Readers of the exports for the tests, which share no code with the product: each image with all that is said of it.

The formats are read as their own documents define them, by text, struct-like layout, PyYAML, json, OpenCV, SQLite and
the libraries mcap and mcap-ros2-support.
"""

import json
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from tests.scenes.test_bag_exports import matrix, ns, read


@dataclass(frozen=True, eq=False)
class View:
    """An image with its stamp (None in formats without), lens, and world_from_cam (4, 4); pixel centres are whole."""

    image: np.ndarray
    stamp_ns: int | None
    K: np.ndarray
    model: str
    distortion: tuple[float, ...]
    world_from_cam: np.ndarray


Views = dict[str, list[View]]


def pinhole(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def rows_of(path: Path) -> list[list[str]]:
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return [re.split(r"[ ,]+", line.strip()) for line in lines]


def picture(path: Path) -> np.ndarray:
    found = cv2.imread(str(path), cv2.IMREAD_COLOR)
    assert found is not None, path
    return found


def ns_of(seconds: str) -> int:
    whole, _, rest = seconds.partition(".")
    assert len(rest) == 9
    return int(whole) * 10**9 + int(rest)


def placed(position: list[float], xyzw: list[float]) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_quat(xyzw).as_matrix(), position
    return out


def shift_ns(folder: Path) -> int:
    """The clocks' offset as README.md says it to a person: the format has no place for it."""
    found = re.search(r"t_imu = t_cam \+ ([-0-9.e]+) s", (folder / "README.md").read_text())
    return round(float(found[1]) * 1e9) if found else 0


def of_tum(folder: Path) -> Views:
    (camera,) = rows_of(folder / "camera.txt")
    K = pinhole(*map(float, camera[:4]))
    poses = {
        row[0]: placed([*map(float, row[1:4])], [*map(float, row[4:])]) for row in rows_of(folder / "groundtruth.txt")
    }
    images = rows_of(folder / "rgb.txt")
    found = [View(picture(folder / name), ns_of(time), K, "none", (), poses[time]) for time, name in images]
    assert all(list(view.image.shape[1::-1]) == [*map(int, camera[4:])] for view in found)
    return {"camera": found}


def of_kitti(folder: Path) -> Views:
    lines = {row[0]: np.array(row[1:], dtype=float).reshape(3, 4) for row in rows_of(folder / "calib.txt")}
    assert ("Tr:" in lines) == (folder / "velodyne").is_dir()
    lines.pop("Tr:", None)
    assert not any(P[:, 3].any() for P in lines.values()), "one camera has no baseline"
    times, poses = rows_of(folder / "times.txt"), rows_of(folder / "poses.txt")
    found = []
    for k, ((time,), row) in enumerate(zip(times, poses, strict=True)):
        pose = np.vstack([np.array(row, dtype=float).reshape(3, 4), [0, 0, 0, 1]])
        image = picture(folder / "image_2" / f"{k:06d}.png")
        found.append(View(image, ns_of(time), lines["P2:"][:, :3], "none", (), pose))
    assert len(list((folder / "image_2").iterdir())) == len(found)
    return {"camera": found}


def of_bop(folder: Path) -> Views:
    scene = folder / "test" / "000001"
    cameras = json.loads((scene / "scene_camera.json").read_text())
    truth = json.loads((scene / "scene_gt.json").read_text())
    found = []
    for name, camera in cameras.items():
        ((object_1,),) = (truth[name],)
        cam_from_model = np.eye(4)
        cam_from_model[:3, :3] = np.array(object_1["cam_R_m2c"]).reshape(3, 3)
        cam_from_model[:3, 3] = np.array(object_1["cam_t_m2c"]) / 1000
        K = np.array(camera["cam_K"]).reshape(3, 3)
        image = picture(scene / "rgb" / f"{int(name):06d}.png")
        found.append(View(image, None, K, "none", (), np.linalg.inv(cam_from_model)))
    assert len(list((scene / "rgb").iterdir())) == len(found)
    return {"camera": found}


def bodies_of_euroc(folder: Path) -> dict[int, np.ndarray]:
    """Matrices of world from body by stamp; quaternions are w first."""
    rows = rows_of(folder / "mav0" / "state_groundtruth_estimate0" / "data.csv")
    return {int(row[0]): placed([*map(float, row[1:4])], [*map(float, [*row[5:8], row[4]])]) for row in rows}


def of_euroc(folder: Path, names: list[str]) -> Views:
    mav, bodies = folder / "mav0", bodies_of_euroc(folder)
    out: Views = {}
    for k, name in enumerate(names):
        said = yaml.safe_load((mav / f"cam{k}" / "sensor.yaml").read_text())
        assert (said["sensor_type"], said["camera_model"]) == ("camera", "pinhole")
        body_from_cam = np.array(said["T_BS"]["data"], dtype=float).reshape(said["T_BS"]["rows"], said["T_BS"]["cols"])
        lens = {"radial-tangential": "radtan"}[said["distortion_model"]], tuple(said["distortion_coefficients"])
        out[name] = [
            View(
                picture(mav / f"cam{k}" / "data" / file), int(stamp), pinhole(*said["intrinsics"]), *lens,
                bodies[int(stamp) + shift_ns(folder)] @ body_from_cam,
            )
            for stamp, file in rows_of(mav / f"cam{k}" / "data.csv")
        ]  # fmt: skip
        assert all(list(view.image.shape[1::-1]) == said["resolution"] for view in out[name])
    assert len(list(mav.glob("cam*"))) == len(names)
    return out


def of_bag(folder: Path) -> Views:
    messages = read(folder)
    moving: dict[str, dict[int, np.ndarray]] = {}
    for _, message in messages["/tf"]:
        for each in message.transforms:
            assert each.header.frame_id == {"base_link": "world"}.get(each.child_frame_id, "base_link")
            pose = matrix(each.transform.translation, each.transform.rotation)
            moving.setdefault(each.child_frame_id, {})[ns(each.header)] = pose
    ((_, message),) = messages["/tf_static"]
    still = {
        each.child_frame_id: matrix(each.transform.translation, each.transform.rotation) for each in message.transforms
    }
    out: Views = {}
    for topic in messages:
        if not topic.endswith("/camera_info"):
            continue
        name = topic.split("/")[1]
        images = messages.get(f"/{name}/image_raw") or messages[f"/{name}/image_rect"]
        out[name] = []
        for (_, info), (_, image) in zip(messages[topic], images, strict=True):
            at = ns(image.header) + shift_ns(folder)
            frame = image.header.frame_id
            assert (ns(info.header), info.header.frame_id) == (ns(image.header), frame)
            assert (info.width, info.height, image.encoding) == (image.width, image.height, "bgr8")
            body_from_cam = still[frame] if frame in still else moving[frame][at]
            pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3)
            lens = {"plumb_bob": "radtan"}[info.distortion_model], tuple(info.d)
            pose = moving["base_link"][at] @ body_from_cam
            out[name].append(View(pixels, ns(image.header), np.reshape(info.k, (3, 3)), *lens, pose))
    return out


def of_colmap(folder: Path) -> Views:
    """COLMAP's pixels have whole borders: the first centre is at 0.5."""
    cameras = {row[0]: row[1:] for row in rows_of(folder / "sparse" / "0" / "cameras.txt")}
    lines = (folder / "sparse" / "0" / "images.txt").read_text().splitlines()
    posed = [line.split() for line in [line for line in lines if not line.startswith("#")][::2]]
    out: Views = {}
    for _, qw, qx, qy, qz, *position, camera, name in posed:
        model, width, height, fx, fy, cx, cy, *distortion = cameras[camera]
        cam_from_world = placed([*map(float, position)], [float(q) for q in (qx, qy, qz, qw)])
        K = pinhole(float(fx), float(fy), float(cx) - 0.5, float(cy) - 0.5)
        lens = {"PINHOLE": "none", "OPENCV": "radtan"}[model], tuple(map(float, distortion))
        image = picture(folder / "images" / name)
        assert image.shape[1::-1] == (int(width), int(height))
        folder_of = name.split("/")[0] if "/" in name else "camera"
        out.setdefault(folder_of, []).append(View(image, None, K, *lens, np.linalg.inv(cam_from_world)))
    return out


def of_transforms(folder: Path) -> Views:
    """nerfstudio's cameras have y up and look along -z; its pixels have whole borders."""
    said = json.loads((folder / "transforms.json").read_text())
    assert said["camera_model"] == "OPENCV"
    K = pinhole(said["fl_x"], said["fl_y"], said["cx"] - 0.5, said["cy"] - 0.5)
    distortion = tuple(said[name] for name in ("k1", "k2", "p1", "p2"))
    found = []
    for each in said["frames"]:
        image = picture(folder / each["file_path"])
        assert image.shape[1::-1] == (said["w"], said["h"])
        pose = np.array(each["transform_matrix"]) @ np.diag([1.0, -1, -1, 1])
        found.append(View(image, each["stamp_ns"], K, "radtan", distortion, pose))
    return {"camera": found}


def views(folder: Path, format: str, names: list[str]) -> Views:
    """All images of an export by the name of their camera; names: those of all cameras, the main one first."""
    if format == "euroc":
        return of_euroc(folder, names)
    readers = {
        "tum": of_tum, "kitti": of_kitti, "bop": of_bop, "mcap": of_bag, "rosbag2": of_bag, "colmap": of_colmap,
        "transforms": of_transforms,
    }  # fmt: skip
    return readers[format](folder)
