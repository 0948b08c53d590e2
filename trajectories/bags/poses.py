"""Trajectories in bags: odometry, stamped poses and transforms, and chains of frames in the tree of /tf.

A pose topic is named as `/odom`, a transform as in evo: `/tf:world.base_link` is the pose of base_link in world.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import numpy as np

from uavbench.trajectories.bags.reading import Bag, BagTopic, opened_bag, stamp_ns
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import LARGEST_COORDINATE_M, MOST_POSES, TRAJECTORY
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.covariances import CovariantTrajectory, PoseCovariances

TF = "tf2_msgs/msg/TFMessage"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
POSE = "geometry_msgs/msg/PoseStamped"
COVARIANT_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
COVARIANT = (ODOMETRY, COVARIANT_POSE)
POSES = (ODOMETRY, POSE, COVARIANT_POSE, TRANSFORM)
"""Message types that hold a pose."""
WORLD = ("world", "map")
"""Names of the fixed frame (REP-105), which is taken as the world."""
BODY = ("base_link", "body")
OPTICAL = ("_optical_frame", "_optical")
"""Suffix of camera frames with x right, y down and z forward (REP-103)."""
UNSAID = "?"
"""Placeholder for a frame that a message does not name."""


@dataclass(frozen=True, eq=False)
class BagPoses:
    """Trajectory of a topic and its frames, such as `world_from_body`; ? where the messages name none.

    camera: the name before `_optical_frame` where the poses are those of such a frame, else "". covariances: those
    given in the messages, None if there are none.
    """

    trajectory: Trajectory
    source: BagTopic
    frame: str
    camera: str = ""
    covariances: PoseCovariances | None = None


@dataclass(frozen=True, eq=False)
class _Rows:
    """Stamps and poses (position, quaternion w x y z) of one frame in another, as recorded.

    covariances: 36 values per pose, empty if the message type has none.
    """

    parent: str
    child: str
    stamps_ns: list[int]
    poses: list[tuple[float, ...]]
    covariances: list[Any] = field(default_factory=list)


def read_poses(source: BagTopic) -> BagPoses:
    """Trajectory of a topic of a bag; if no topic is named, of the only one with poses.

    Stamps are those of the message headers, sorted. UserError naming the invalid bag, topic or message.
    """
    with opened_bag(source.bag) as bag:
        topic, _, ends = (source.topic or _only(bag)).partition(":")
        named = BagTopic(source.bag, f"{topic}:{ends}" if ends else topic)
        if topic in bag.topics and bag.topics[topic].type == TF:
            parent, _, child = ends.partition(".")
            found = CovariantTrajectory(_through_tree(bag, named, parent, child))
        else:
            rows = _of_topic(bag, topic)
            parent, child, found = rows.parent, rows.child, _covariant(named, rows)
        frame = f"{_fixed(parent)}_from_{_moving(child)}"
        return BagPoses(found.trajectory, named, frame, _camera(child), found.covariances)


def _only(bag: Bag) -> str:
    """The only topic of a bag with poses; UserError when there is none or more than one."""
    found = bag.of_types(POSES)
    if len(found) == 1:
        return found[0]
    many = f"has {len(found)} topics with poses, {', '.join(found)}" if found else "has no topic with poses"
    raise UserError(
        f"{bag.path}: {many}; name one as {bag.path}:/topic, or {bag.path}:/tf:world.base_link; " + bag.listed()
    )


def _of_topic(bag: Bag, topic: str) -> _Rows:
    kind = bag.topics[topic].type if topic in bag.topics else ""
    ends: tuple[str, str] | None = None
    stamps: list[int] = []
    poses: list[tuple[float, ...]] = []
    covariances: list[Any] = []
    for number, message in enumerate(bag.messages(topic, POSES)):
        now = (message.header.frame_id, getattr(message, "child_frame_id", ""))
        ends = ends or now
        if now != ends:
            raise UserError(
                f"{bag.path}: message {number} of {topic} is of {_pair(*now)}, earlier ones of {_pair(*ends)}; a "
                "trajectory has one frame"
            )
        stamps.append(stamp_ns(message.header))
        poses.append(_numbers(message.transform) if kind == TRANSFORM else _numbers(_pose(message)))
        if kind in COVARIANT:
            covariances.append(np.array(message.pose.covariance, dtype=np.float64))
        _count(bag, topic, len(stamps))
    parent, child = ends or ("", "")
    return _Rows(parent, child, stamps, poses, covariances)


def _through_tree(bag: Bag, source: BagTopic, parent: str, child: str) -> Trajectory:
    """Poses of a frame in one of its ancestors, through at most one transform that changes with time.

    A transform that is sent again and again with the same pose, as ROS 1 sends static ones, does not change.
    """
    topic = source.topic.partition(":")[0]
    tree = _tree(bag, topic)
    known = f"the bag's transforms: {', '.join(sorted(f'{rows.parent}.{rows.child}' for rows in tree.values()))}"
    if not (parent and child):
        raise UserError(f"{bag.path}: name two frames of {topic}, as {bag.path}:{topic}:world.base_link; {known}")
    chain: list[_Rows] = []
    here = child
    while here != parent:
        if here not in tree or len(chain) > len(tree):
            raise UserError(f"{bag.path}: {parent!r} is not an ancestor of {child!r} in {topic}; {known}")
        chain.insert(0, tree[here])
        here = tree[here].parent
    sent = [k for k, rows in enumerate(chain) if len(rows.stamps_ns) > 1]
    moving = [k for k in sent if len(set(chain[k].poses)) > 1] or sent
    if len(moving) != 1:
        names = " and ".join(f"{chain[k].parent}.{chain[k].child}" for k in moving) or "none"
        raise UserError(
            f"{bag.path}: changing transforms between {parent!r} and {child!r}: {names}; name two frames with exactly "
            f"one between them; {known}"
        )
    parts = [_trajectory(source, rows) for rows in chain]
    moved = parts[moving[0]]
    if len(chain) == 1:
        return moved
    left, right = (_product(some) for some in (parts[: moving[0]], parts[moving[0] + 1 :]))
    return Trajectory.from_poses(moved.stamps_ns.tolist(), [left @ moved.pose(k) @ right for k in range(len(moved))])


def _product(still: list[Trajectory]) -> Pose:
    return reduce(lambda a, b: a @ b, (each.pose(0) for each in still), Pose.identity())


def _tree(bag: Bag, topic: str) -> dict[str, _Rows]:
    """Transforms of a topic and of /tf_static, by their child frame."""
    tree: dict[str, _Rows] = {}
    static = f"{topic.removesuffix('_static')}_static"
    for name in dict.fromkeys((topic, static)):
        if name != topic and not (name in bag.topics and bag.topics[name].messages):
            continue
        for transform in _transforms(bag, name):
            parent, child = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
            rows = tree.setdefault(child, _Rows(parent, child, [], []))
            if rows.parent != parent:
                raise UserError(f"{bag.path}: {child!r} has two parents in {topic}, {rows.parent!r} and {parent!r}")
            if name == static:
                rows.stamps_ns.clear()  # the latest one applies
                rows.poses.clear()
            rows.stamps_ns.append(stamp_ns(transform.header))
            rows.poses.append(_numbers(transform.transform))
            _count(bag, topic, len(rows.stamps_ns))
    return tree


def _transforms(bag: Bag, topic: str) -> Iterator[Any]:
    for message in bag.messages(topic, (TF,)):
        yield from message.transforms


def _trajectory(source: BagTopic, rows: _Rows) -> Trajectory:
    return _covariant(source, rows).trajectory


def _covariant(source: BagTopic, rows: _Rows) -> CovariantTrajectory:
    """Trajectory sorted by header stamps, without repeated rows; UserError naming the first bad message."""
    table = np.array(rows.poses, dtype=np.float64).reshape(-1, 7)
    stamps = np.array(rows.stamps_ns, dtype=np.int64)
    order = np.argsort(stamps, kind="stable")
    stamps, table = stamps[order], table[order]
    again = np.concatenate([[False], (stamps[1:] == stamps[:-1]) & (table[1:] == table[:-1]).all(axis=1)])
    stamps, table, order = stamps[~again], table[~again], order[~again]
    positions, quaternions = table[:, :3], table[:, 3:]
    for what, bad in _faults(stamps, positions, quaternions):
        if bad.any():
            raise UserError(f"{source}: message {order[int(np.argmax(bad))]}: {what}")
    trajectory = Trajectory(stamps, positions, quaternions)
    if not rows.covariances:
        return CovariantTrajectory(trajectory)
    return CovariantTrajectory(
        trajectory, PoseCovariances.of_columns(np.array(rows.covariances).reshape(-1, 36)[order], "fixed")
    )


def _faults(stamps: np.ndarray, positions: Array, quaternions: Array) -> Iterator[tuple[str, Any]]:
    with np.errstate(invalid="ignore", over="ignore"):
        yield (
            f"its position is not finite, or beyond {LARGEST_COORDINATE_M:g} m",
            ~(np.abs(positions) <= LARGEST_COORDINATE_M).all(axis=1),
        )
        yield (
            "its quaternion is not of unit norm (1e-3)",
            ~(np.abs(np.linalg.norm(quaternions, axis=1) - 1) < 1e-3),
        )
    yield (
        "another pose has the same stamp; do its headers have stamps?",
        np.concatenate([[False], np.diff(stamps) <= 0]),
    )


def _pose(message: Any) -> Any:
    """The pose of a message, without its covariance if it has one."""
    return getattr(message.pose, "pose", message.pose)


def _numbers(pose: Any) -> tuple[float, ...]:
    """Position and quaternion wxyz of a pose or a transform."""
    p = pose.position if hasattr(pose, "position") else pose.translation
    q = pose.orientation if hasattr(pose, "orientation") else pose.rotation
    return p.x, p.y, p.z, q.w, q.x, q.y, q.z


def _count(bag: Bag, topic: str, count: int) -> None:
    if count > MOST_POSES:
        raise UserError(f"{bag.path}: {topic} has more than {MOST_POSES:,} poses; {TRAJECTORY.remedy}")


def _pair(parent: str, child: str) -> str:
    return f"{child or UNSAID} in {parent or UNSAID}"


def _fixed(name: str) -> str:
    plain = name.lstrip("/")
    return "world" if plain in WORLD else plain or UNSAID


def _moving(name: str) -> str:
    plain = name.lstrip("/")
    if plain in BODY:
        return "body"
    return "cam" if plain.endswith(OPTICAL) else plain or UNSAID


def _camera(name: str) -> str:
    """Name of the camera of an optical frame, "" for other frames."""
    plain = name.lstrip("/")
    return next((plain.removesuffix(end) for end in OPTICAL if plain.endswith(end)), "")
