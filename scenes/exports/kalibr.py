"""The calibration of a sequence in the files of Kalibr (wiki, "Yaml formats"): camchain-imucam.yaml, imu0.yaml ..."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from uavbench.scenes.camera import Camera
from uavbench.scenes.exports.euroc import COEFFICIENTS, NOISE, body_from_imu, imus_of, yaml_number
from uavbench.scenes.exports.notes import Held
from uavbench.scenes.exports.ros.bag_messages import image_topic, ros_name
from uavbench.scenes.exports.shown_images import Shown
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Pose

MODELS = {"none": "radtan", "radtan": "radtan", "equidistant": "equidistant"}
"""Kalibr's model names; a camera without distortion is radtan with four zeros, which every reader accepts."""
CHAIN = "camchain-imucam.yaml"


def export_kalibr(shown: Shown, folder: Path, on_frame: Callable[[int, int], None]) -> Held:
    """`camchain-imucam.yaml` of all cameras and imu0, and a file of the noise of each IMU; no images and no poses.

    T_cn_cnm1 maps points of the previous camera to this one, T_cam_imu points of imu0 to the camera, and
    t_imu = t_cam + timeshift_cam_imu. Without an IMU there is no T_cam_imu: the chain is that of the cameras alone.
    """
    sequence = shown.sequence
    imus = imus_of(sequence)
    first = next(iter(imus.items()), None)
    body_from_first = None if first is None else body_from_imu(sequence.body_folder / first[0], first[1])
    write_text(folder / CHAIN, camera_chain(shown, body_from_first))
    files = {
        CHAIN: "intrinsics, distortion, T_cn_cnm1, T_cam_imu of imu0, timeshift_cam_imu (t_imu = t_cam + shift), topics"
    }
    for k, (name, imu) in enumerate(imus.items()):
        write_text(folder / f"imu{k}.yaml", _imu_yaml(name, imu))
        files[f"imu{k}.yaml"] = f"noise densities, random walks and rate of `{name}`"
    for frame in range(len(sequence)):
        on_frame(frame + 1, len(sequence))
    limits = ["Images, poses and readings are not included: these files are their calibration."]
    limits += [f"Mount: that of imu{k} (`{name}`) on the body is not included." for k, name in enumerate(imus) if k]
    limits += [f"Parameters: `{name}` is not described in sequence.json." for name, imu in imus.items() if not imu]
    return Held(
        files=files, frames={}, limits=tuple(limits), cameras=tuple(sequence.cameras), time_shift=first is not None
    )


def camera_chain(shown: Shown, body_from_imu: Pose | None) -> str:
    """Text of the chain of all cameras of a sequence."""
    lines: list[str] = []
    cameras = shown.cameras
    before: Pose | None = None
    for own, (name, each) in enumerate(cameras.items()):
        cam_from_body = each.sequence.cam_from_body
        lines += [f"cam{own}:", *_lens(each.camera)]
        overlaps = ", ".join(str(k) for k in range(len(cameras)) if k != own)
        lines += [f"  cam_overlaps: [{overlaps}]", f"  rostopic: {image_topic(name, each)}"]
        if before is not None:
            lines += _matrix("T_cn_cnm1", cam_from_body @ before.inverse())
        if body_from_imu is not None:
            lines += _matrix("T_cam_imu", cam_from_body @ body_from_imu)
            lines.append(f"  timeshift_cam_imu: {yaml_number(shown.sequence.timeshift_cam_imu_ns / 1e9)}")
        before = cam_from_body
    return "\n".join(lines) + "\n"


def _lens(camera: Camera) -> list[str]:
    coefficients = (*camera.distortion, 0.0, 0.0, 0.0, 0.0)[:COEFFICIENTS]
    return [
        "  camera_model: pinhole",
        f"  intrinsics: [{', '.join(map(yaml_number, (camera.fx, camera.fy, camera.cx, camera.cy)))}]",
        f"  distortion_model: {MODELS[camera.distortion_model]}",
        f"  distortion_coeffs: [{', '.join(map(yaml_number, coefficients))}]",
        f"  resolution: [{camera.width}, {camera.height}]",
    ]


def _matrix(name: str, pose: Pose) -> list[str]:
    return [f"  {name}:", *(f"  - [{', '.join(map(yaml_number, row))}]" for row in pose.matrix.tolist())]


def _imu_yaml(name: str, imu: dict[str, Any]) -> str:
    lines = [f"rostopic: /{ros_name(name)}/data_raw"]
    lines += [f"{key}: {yaml_number(imu[of])}  # {unit}" for key, (of, unit) in NOISE.items() if of in imu]
    if "rate_hz" in imu:
        lines.append(f"update_rate: {yaml_number(imu['rate_hz'])}")
    return "\n".join(lines) + "\n"
