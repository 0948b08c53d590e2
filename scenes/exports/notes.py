"""README.md and export.json of an export: its content, and what its format cannot represent."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uavbench.scenes.dataset.disk_guards import inside
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import ANEW
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import TABLE
from uavbench.trajectories.files.tables import column_names
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.trajectory_files.export_description import EXPORT


@dataclass(frozen=True, kw_only=True)
class Held:
    """Content of an export.

    files: description of each file or folder; frames: frames of the poses in a file, by its path; sensors, annotations
    and cameras: the readings, annotations and further cameras that are exported; limits: what was left out or changed;
    angular_rates: whether the body's rates are exported; moving_mounts: whether a gimbal's motion is; time_shift:
    whether the offset of the camera's clock is; camera_axes: convention of camera and image axes.
    """

    files: dict[str, str]
    frames: dict[str, str]
    sensors: tuple[str, ...] = ()
    annotations: tuple[str, ...] = ()
    limits: tuple[str, ...] = ()
    angular_rates: bool = False
    cameras: tuple[str, ...] = ()
    time_shift: bool = False
    moving_mounts: bool = False
    readme: str = "README.md"
    camera_axes: str = "camera x right, y down, z forward; pixel centres at whole numbers"


def shown_name(sequence: Sequence) -> str:
    """Name of the camera that a sequence is of: MAIN, or that of a further camera that is exported in its place."""
    return MAIN if sequence.vehicle is None else sequence.folder.name


def sensors_of(sequence: Sequence) -> dict[str, dict[str, Any]]:
    """Parameters of each body sensor of a sequence by the file of its readings; UserError when it cannot be read."""
    sensors = sequence.info.get("sensors", {})
    if not (isinstance(sensors, dict) and all(isinstance(sensor, dict) for sensor in sensors.values())):
        raise UserError(f"{sequence.folder / 'sequence.json'}: `sensors` is not a table of tables; {ANEW}")
    for name in sensors:
        inside(sequence.body_folder, name)
    return sensors


def tables_of(sequence: Sequence) -> dict[str, dict[str, Any]]:
    """Parameters of the body sensors whose readings are a CSV file, by that file."""
    return {name: about for name, about in sensors_of(sequence).items() if name.endswith(".csv")}


def tables_with(
    sequence: Sequence, columns: list[str], kind: str, unlisted: Iterable[str] = ()
) -> dict[str, dict[str, Any]]:
    """Parameters of the body sensors whose tables have these columns, by the file; those of `unlisted` files are empty.

    UserError for the table of a sensor of this kind (`imu`, `imu-bmi088`) that lacks stamps or one of them.
    """
    folder, sensors, found = sequence.body_folder, tables_of(sequence), {}
    sensors |= {name: {} for name in unlisted if name not in sensors}
    for name, about in sensors.items():
        names = column_names(folder / name, TABLE, inside=folder)
        missing = [column for column in ("stamp_ns", *columns) if column not in names]
        if missing and f"{about.get('kind')}-".startswith(f"{kind}-"):
            raise UserError(
                f"{folder / name}: missing columns {', '.join(missing)}, which readings of kind = {about['kind']!r} in "
                "sequence.json have; name them in the first line, separated by commas"
            )
        if not set(missing) & set(columns):
            found[name] = about
    return found


def not_held(sequence: Sequence, held: Held, undistorted: bool) -> list[str]:
    """One sentence for each part of the sequence that an export does not contain."""
    info = sequence.info
    lines = list(held.limits)
    views = {"": sequence} | {f" of `{name}`": sequence.cameras[name] for name in held.cameras}
    lenses = {of: view.camera for of, view in views.items()}
    lines += [
        f"Lens: the images{of} are undistorted ({lens.distortion_model} {list(lens.distortion)}); pixels outside the "
        "lens's field of view are black, and sharpness and noise differ."
        for of, lens in lenses.items()
        if undistorted and lens.distortion_model != "none"
    ]
    for name, sensor in sensors_of(sequence).items():
        if name not in held.sensors:
            lines.append(f"Sensor readings: `{name}` ({sensor.get('kind', 'own')}) is not included.")
    lines += [
        f"Cameras: `{name}` is not included; this format has one camera, and `--camera {name}` exports that one."
        for name in sequence.cameras
        if name not in held.cameras
    ]
    if sequence.on_gimbal and not held.moving_mounts:
        lines.append("Gimbal: the camera's pose on the body at each image (`mounts.csv`) is not included.")
    shift_ns = sequence.timeshift_cam_imu_ns
    if shift_ns and not held.time_shift:
        lines.append(
            f"Clock: t_imu = t_cam + {shift_ns / 1e9:g} s; images keep the stamps of their own clock, and the format "
            "cannot represent the offset."
        )
    lines += [line for of, view in views.items() for line in _camera(of, view)]
    lines += _images(sequence)
    for name in ("depth", "mask", "edges", "flow", "occlusion", "normals"):
        if name not in held.annotations and (sequence.folder / name).is_dir():
            lines.append(f"Annotations: `{name}/` is not included.")
    if (sequence.folder / "crlb.csv").is_file():
        lines.append("Bounds: the Cramer-Rao bounds of `crlb.csv` are not included.")
    if (sequence.body_folder / "flight.csv").is_file():
        rates = "" if held.angular_rates else "angular rates, "
        lines.append(f"Flight: accelerations, {rates}thrusts and wind of `flight.csv` are not included.")
    if any((info.get("deviation") or {}).values()):
        lines.append("Model: the images show the structure as built; the model is the structure as designed.")
    return lines


def write_notes(sequence: Sequence, format: str, folder: Path, held: Held, undistorted: bool) -> tuple[str, ...]:
    """Write README and export.json of an export; returns the sentences on what it does not contain."""
    missing = not_held(sequence, held, undistorted)
    about: dict[str, Any] = {
        "format": format,
        "sequence": sequence.name,
        "content_hash": sequence.content_hash,
        "camera": shown_name(sequence),
        "timeshift_cam_imu_ns": sequence.timeshift_cam_imu_ns,
        "undistorted": undistorted,
        "frames": held.frames,
        "not_held": missing,
    }
    write_text(folder / EXPORT, json.dumps(about, indent=1) + "\n")
    of = "" if shown_name(sequence) == MAIN else f", camera `{shown_name(sequence)}`"
    lines = [
        f"# {sequence.name}{of} in the format {format}",
        "",
        "Exported by uavbench. Metres and seconds unless a line says otherwise; the world is the structure's frame, z "
        f"up; body x forward, y left, z up; {held.camera_axes}. The stamp of an image is the middle of its exposure.",
        "",
        "## Included",
        "",
        *(f"- `{name}`: {about}" for name, about in held.files.items()),
        "",
        "## Not included",
        "",
        *(f"- {line}" for line in missing),
    ]
    write_text(folder / held.readme, "\n".join(lines) + "\n")
    return tuple(missing)


def _camera(of: str, view: Sequence) -> list[str]:
    """What no format holds of a camera: its rolling shutter, its response, its masked pixels; of: " of `right`"."""
    camera, lines = view.camera, []
    if camera.readout_ms:
        delay_ns = 1e6 * camera.readout_ms / max(camera.height - 1, 1)
        first = ", the last one first" if delay_ns < 0 else ""
        names = ("row_poses.npy", "row_mounts.npy")
        poses = ", ".join(f"`{name}`" for name in names if (view.folder / name).is_file())
        lines.append(
            f"Rolling shutter: rows{of} are exposed {abs(delay_ns):.0f} ns apart{first}; stamps and poses are those of "
            f"the middle row{f', and the pose of each row ({poses}) is not included' if poses else ''}."
        )
    if camera.response != "srgb":
        lines.append(
            f"Response: the codes of the images{of} follow light by `response = {json.dumps(camera.response)}`, and "
            "not as those of sRGB."
        )
    if camera.masked:
        lines.append(
            f"Masked pixels: {len(camera.masked)} polygons{of} in which the images show no scene (`masked` of "
            "`camera.toml`) are not included."
        )
    return lines


def _images(sequence: Sequence) -> list[str]:
    """What no file tells of the images: colours that the lens displaces, frames dropped and duplicated by the link."""
    listed = (sequence.info.get("config") or {}).get("effects") or ()
    effects = {str(effect.get("kind")): effect for effect in listed}
    lines = []
    if "lateral-colour" in effects:
        red_px, blue_px = (effects["lateral-colour"].get(key) for key in ("red_px", "blue_px"))
        lines.append(
            f"Lens: red and blue are displaced outwards from green, by {red_px} and {blue_px} px at the corner; the "
            "calibration is that of green."
        )
    if "drops" in effects and "rate_hz" in sequence.info:
        period_ns = 1e9 / float(sequence.info["rate_hz"])
        stamps = sequence.stamps_ns
        lost = round(float(stamps[-1] - stamps[0]) / period_ns) + 1 - len(stamps) if len(stamps) else 0
        lines.append(
            f"Link: {lost} frames were lost, so stamps have gaps; a repeated frame shows the image before with a "
            f"new stamp (probability {effects['drops'].get('repeated', 0)}), and nothing marks it."
        )
    if "analog-link" in effects:
        lines.append("Link: scan lines are shifted by the analog link, by amounts that are not recorded.")
    return lines
