"""Model-based trackers: one stage per file, one short file per variant.

On a vehicle, from camera frames to poses, with numpy, OpenCV and numba alone::

    from pathlib import Path

    import numpy as np

    from uavbench.scenes.camera import Camera
    from uavbench.scenes.structure import Structure
    from uavbench.tracker.initialization import read_init
    from uavbench.tracker.robust.tracker import Robust

    camera = Camera.load(Path("camera.toml"))
    structure = Structure.from_mesh(vertices, triangles)  # metres; counter-clockwise from outside
    first = read_init(Path("init.toml"), camera)
    run = Robust().start(structure, camera, first, np.random.default_rng(0))
    for stamp_ns, image in frames:  # (h, w, 3) BGR or (h, w) grey, uint8
        result = run.track(image, stamp_ns)
        if result.status == "ok":
            steer(result.cam_from_world.inverse(), result.covariance)
"""
