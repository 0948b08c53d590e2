"""What keeps gimbals from what they look at."""

from collections.abc import Callable
from collections.abc import Sequence as Sequenced

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.shots.cameras import cameras_of
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.pose import Pose


def missed_targets(
    spec: SequenceSpec, mounts: Sequenced[Callable[[int], Pose]], times_ns: Sequenced[NDArray[np.int64]]
) -> list[str]:
    """What keeps each gimbal from its target at the times of its frames, in the order of the cameras.

    UserError when one never sees it.
    """
    found = []
    for camera, mount, stamps_ns in zip(cameras_of(spec), mounts, times_ns, strict=True):
        if not (isinstance(camera.mount, Gimbal) and isinstance(mount, GimbalMotion)):
            continue
        try:
            what = camera.mount.unreached(mount, stamps_ns)
        except UserError as error:
            raise UserError(f"sequence {spec.name}: camera {camera.name}: {error}") from None
        found += [missed_target(camera.name, what)] if what else []
    return found


def missed_target(camera: str, what: str) -> str:
    """Line of `unreached` in a record: what keeps the gimbal of a camera from its target."""
    return f"gimbal of {camera}: {what}"
