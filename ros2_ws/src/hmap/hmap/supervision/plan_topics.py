"""What the supervisor publishes of plans: hmap's own message, and what RViz, Foxglove and other programs draw."""

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import Header, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import MarkerArray

from hmap.naming import Naming
from hmap.node import LATCHED, HmapNode
from hmap.supervision.latched import LatchedOnDemand
from hmap.supervision.markers import markers_of
from hmap_core.types import Plan
from hmap_msgs.msg import Plan as PlanMessage
from hmap_msgs_py.poses import poses_to_messages

MOST_POINTS = 200  # of a trajectory for other programs; the plan itself has all
SEARCH_PERIOD = 0.5  # s between two states of a search that goes on
NANOSECONDS = 10**9


class PlanTopics:
    """The topics of plans, all latched.

    Args:
        node: that publishes.
        naming: of joints; the key "arm_joint".
        frame: in which poses are.
    """

    def __init__(self, node: HmapNode, naming: Naming, frame: str):
        self._node, self._naming, self._frame = node, naming, frame
        self._plan = node.create_publisher(PlanMessage, "plan", LATCHED)
        self._markers = LatchedOnDemand(node, MarkerArray, "markers")
        self._trajectory = LatchedOnDemand(node, JointTrajectory, "planned_trajectory")
        self._path = LatchedOnDemand(node, Path, "planned_path")
        self._search = node.create_publisher(String, "search_tree", LATCHED)
        self._searched = 0.0  # when the search was told last, s of the steady clock

    def publish(self, plan: Plan, message: PlanMessage, stamp: Time) -> None:
        """Publish a new plan; ``message`` is the plan as a message."""
        self._plan.publish(message)
        self._markers.publish(lambda: markers_of(plan, stamp, self._frame))
        self._trajectory.publish(lambda: trajectory_of(plan, self._naming, stamp, self._frame))
        self._path.publish(lambda: path_of(plan, stamp, self._frame))
        if "search" in plan.stats:
            self.search_ended(plan.stats["search"])

    def searching(self, tree: Callable[[], dict[str, Any]] | None) -> None:
        """Publish what a search has tried, from time to time, where somebody listens."""
        now = time.monotonic()
        if tree is None or now - self._searched < SEARCH_PERIOD or not self._search.get_subscription_count():
            return
        self._searched = now
        self._search.publish(String(data=json.dumps(tree())))

    def search_ended(self, tree: dict[str, Any]) -> None:
        """Publish what a search that has ended has tried, with the reasons of its failures."""
        self._search.publish(String(data=json.dumps(tree)))


def trajectory_of(plan: Plan, naming: Naming, stamp: Time, frame: str) -> JointTrajectory:
    """The joints of all robots over a plan, at MOST_POINTS of its samples at most.

    Args:
        plan: the plan.
        naming: of joints.
        stamp: of the message.
        frame: of its header.
    """
    message = JointTrajectory(header=Header(stamp=stamp, frame_id=frame))
    robots = [name for name in plan.scene.robots if name in plan.trajectory.joints]
    for name in robots:
        message.joint_names.extend(naming.arm_joints(name, plan.scene.robots[name].model))
    joints = np.concatenate([plan.trajectory.joints[name] for name in robots], axis=1)
    for k in _samples(plan):
        nanoseconds = round(float(plan.trajectory.time[k]) * NANOSECONDS)
        since = Duration(sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)
        message.points.append(JointTrajectoryPoint(positions=joints[k].tolist(), time_from_start=since))
    return message


def path_of(plan: Plan, stamp: Time, frame: str) -> Path:
    """The path of the goal's object, at MOST_POINTS of its samples at most."""
    header = Header(stamp=stamp, frame_id=frame)
    poses = plan.trajectory.objects.get(plan.scene.goal.object, np.zeros((0, 7)))
    chosen = poses_to_messages(poses[_samples(plan)]) if len(poses) else []
    message = Path(header=header)
    for pose in chosen:
        stamped = PoseStamped(header=header)
        stamped.pose = pose
        message.poses.append(stamped)
    return message


def _samples(plan: Plan) -> list[int]:
    count = len(plan.trajectory.time)
    return np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).round().astype(int)).tolist()
