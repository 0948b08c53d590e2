"""A tracker for uavbench in one file: edges of the model, searched for in the image along their normals (RAPID).

Needs Python 3.11, numpy and OpenCV, nothing of uavbench. Its folder holds what a tracker may know; frames come on
standard input, one line of answer for each goes to standard output.
"""

import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np

SPACING, REACH, PASSES = 1 / 80, 1 / 40, 4  # of the image's width: between control points, and of a search line


def read_job():
    """Camera matrix, distortion, vertices, a triangle of each planar face, edges and the initial pose."""
    camera = tomllib.loads(Path("camera.toml").read_text())
    K = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1.0]])
    distortion = np.array(camera["distortion"] or [0.0] * 4)
    assert camera["distortion_model"] in ("none", "radtan"), "this example knows no fisheye"
    vertices, triangles = [], []
    for line in Path("model.obj").read_text().splitlines():
        match line.split():
            case ["v", *xyz]:
                vertices.append([float(v) for v in xyz])
            case ["g", _]:
                triangles.append(None)  # a new planar face: one triangle of it is enough
            case ["f", *corners] if triangles[-1] is None:
                triangles[-1] = [int(c) - 1 for c in corners]
    edges = np.loadtxt("edges.csv", delimiter=",", skiprows=1, dtype=int).reshape(-1, 4)
    pose = np.array(tomllib.loads(Path("init.toml").read_text())["cam_from_model"])
    return K, distortion, np.array(vertices), np.array(triangles), edges, pose


def visible(vertices, triangles, edges, pose):
    """Edges that touch a face turned towards the camera."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    centre = -pose[:3, :3].T @ pose[:3, 3]
    faces = np.append(np.einsum("ij,ij->i", np.cross(b - a, c - a), centre - a) > 0, False)  # the last is "no face"
    return edges[faces[edges[:, 2]] | faces[edges[:, 3]], :2]


def control_points(ends, K, distortion, pose, size):
    """Points on the edges, their pixels and their unit normals in the image."""
    rvec = cv2.Rodrigues(pose[:3, :3])[0]

    def project(points):
        return cv2.projectPoints(points, rvec, pose[:3, 3], K, distortion)[0][:, 0]

    spacing, reach = size[0] * SPACING, size[0] * REACH
    points, normals = [], []
    for start, end in ends:
        if min(pose[2, :3] @ start + pose[2, 3], pose[2, :3] @ end + pose[2, 3]) < 0.05:
            continue
        p, q = project(np.array([start, end]))
        count = int(min(np.linalg.norm(q - p), 2000) / spacing)
        share = (np.arange(count) + 0.5)[:, None] / max(count, 1)
        points.append(start + share * (end - start))
        direction = (q - p) / max(np.linalg.norm(q - p), 1e-9)
        normals.append(np.tile([-direction[1], direction[0]], (count, 1)))
    if not points:
        return np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 2))
    points, normals = np.concatenate(points), np.concatenate(normals)
    pixels = project(points) if len(points) else np.zeros((0, 2))
    inside = ((pixels >= reach) & (pixels < np.array(size) - reach)).all(axis=1)
    return points[inside], pixels[inside], normals[inside]


def update(image, points, pixels, normals, K, pose):
    """The pose after one weighted least-squares step to the strongest gradient on each search line."""
    reach = round(image.shape[1] * REACH)
    steps = np.arange(-reach, reach + 1)
    at = (pixels[:, None] + steps[:, None] * normals[:, None]).astype(np.float32)
    profile = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR).astype(float)
    gradient = np.abs(np.gradient(profile, axis=1))
    distance = steps[(gradient / (1 + np.abs(steps) / reach)).argmax(axis=1)].astype(float)
    weight = np.where(gradient.max(axis=1) > 4, 1 / (1 + (distance / (reach / 3)) ** 2), 0)
    if np.count_nonzero(weight) < 8:
        return None
    x, y, z = (points @ pose[:3, :3].T + pose[:3, 3]).T
    nx, ny = normals[:, 0] * K[0, 0], normals[:, 1] * K[1, 1]
    along = np.stack([nx / z, ny / z, -(nx * x + ny * y) / z**2], axis=1)  # d(pixel along the normal)/d(point)
    J = np.hstack([along, np.cross(np.stack([x, y, z], axis=1), along)])
    twist = np.linalg.solve((J.T * weight) @ J + 1e-6 * np.eye(6), (J.T * weight) @ distance)
    step = np.eye(4)
    step[:3, :3], step[:3, 3] = cv2.Rodrigues(twist[3:])[0], twist[:3]
    return step @ pose


def quaternion(R):
    """Unit quaternion, w first."""
    rvec = cv2.Rodrigues(R)[0].ravel()
    angle = np.linalg.norm(rvec)
    return [np.cos(angle / 2), *(np.sin(angle / 2) * rvec / max(angle, 1e-12))]


def main():
    """Answer each frame with a pose."""
    K, distortion, vertices, triangles, edges, pose = read_job()
    print("ready", flush=True)
    while line := sys.stdin.buffer.readline():
        kind, *rest = line.decode().strip().split(",")
        if kind != "frame":  # `imu,...`: this tracker has no use for it
            continue
        stamp, width, height, channels = map(int, rest)
        pixels = np.frombuffer(sys.stdin.buffer.read(width * height * channels), np.uint8)
        image = pixels.reshape(height, width, channels)
        image = cv2.GaussianBlur(image if channels == 1 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (5, 5), 1)
        new = pose
        for _ in range(PASSES):
            ends = vertices[visible(vertices, triangles, edges, new)]
            new = update(image, *control_points(ends, K, distortion, new, (width, height)), K, new)
            if new is None:
                break
        if new is None:
            print(f"{stamp},lost", flush=True)
            continue
        pose = new
        numbers = [*pose[:3, 3], *quaternion(pose[:3, :3])]
        print(f"{stamp},ok," + ",".join(f"{v:.12g}" for v in numbers), flush=True)


if __name__ == "__main__":
    main()
