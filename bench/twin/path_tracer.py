"""A renderer whose images are path traced by Blender, and whose geometry is rasterized as for every sequence."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from uavbench.bench.twin.blender import Blender, OpenScene, opened
from uavbench.bench.twin.scene_files import blender_camera, blender_pose, write_scene
from uavbench.scenes.camera import Camera
from uavbench.scenes.rendering.camera_simulator import Geometry
from uavbench.scenes.rendering.lighting import cloud_shift
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.scene import Scene
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.processes.guard import Guard


@dataclass(frozen=True, eq=False)
class TracedScene:
    """A scene whose views Blender renders.

    samples: per pixel; denoisers: name of the denoiser of each renderer made so far.
    """

    scene: Scene
    blender: Blender
    samples: int
    denoisers: list[str] = field(default_factory=list)

    @contextmanager
    def renderer(self, width: int, height: int) -> Iterator["PathTracer"]:
        """A renderer of the scene for views of a size in px; UserError when Blender fails."""
        with Guard("uavbench-twin-") as guard:
            write_scene(self.scene, guard.folder)
            with self.scene.renderer(width, height) as drawn, opened(self.blender, guard, self.samples) as scene:
                self.denoisers.append(scene.denoiser)
                yield PathTracer(self.scene, drawn, scene)


class PathTracer:
    """Renders views of a scene that is open in Blender."""

    def __init__(self, scene: Scene, drawn: Renderer, opened: OpenScene) -> None:
        self._scene, self._drawn, self._opened = scene, drawn, opened

    def color(self, cam_from_world: Pose, camera: Camera, time_s: float = 0.0) -> NDArray[np.uint8]:
        """Image (h, w, 3) BGR of a pinhole camera, coded like `Renderer.color`: square root of linear radiance.

        UserError when Blender fails.
        """
        light = self._scene.light
        request = {
            "camera": blender_camera(camera),
            "world_from_camera": blender_pose(cam_from_world),
            "world_from_movers": [m.world_from_part(time_s).matrix.tolist() for m in self._scene.movers],
            "seed": round(time_s * 1e6) % 2**31,
        }
        if light.clouds is not None:
            request["cloud_shift"] = cloud_shift(light, light.clouds, time_s).tolist()
        radiance = self._opened.light(request, camera.width, camera.height)
        return np.asarray(np.rint(255 * np.sqrt(np.clip(radiance, 0, 1))), dtype=np.uint8)

    def geometry(self, cam_from_world: Pose, camera: Camera, time_s: float = 0.0) -> Geometry:
        """Depth and instances (h, w) of `Renderer.geometry`: a twin shares its sequence's."""
        return self._drawn.geometry(cam_from_world, camera, time_s)

    def nearest_m(self, eye: Array) -> float:
        """Lower bound in m of the distance from a point (3,) in the world to the static scene."""
        return self._drawn.nearest_m(eye)
