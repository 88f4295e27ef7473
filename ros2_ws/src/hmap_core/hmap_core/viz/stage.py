"""A plan in a simulated world: robots and bodies where the plan has them at a sample."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from hmap_core import transforms
from hmap_core.collision.convex import hull_vertices
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.types import Body, Plan
from hmap_core.viz.key_frames import contact_at

INSIDE = 0.9  # of the way from the middle of a shape to its surface, where its points are looked for
MOST_POINTS = 12  # of a shape
WRIST = 0.12  # m from the end-effector frame back along the approach: the point that stands for the hand


class Stage:
    """A plan in a simulated world of its own, which :meth:`close` frees.

    Attributes:
        plan: what is shown.
        world: where it is shown.
    """

    def __init__(self, plan: Plan):
        self.plan = plan
        self.world = SimulatedWorld(plan.scene)

    def __enter__(self) -> "Stage":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def show(self, sample: int) -> None:
        """Put everything where it is at a sample."""
        trajectory = self.plan.trajectory
        for name, q in trajectory.joints.items():
            opening = trajectory.gripper.get(name)
            self.world.robot(name).place(q[sample], 0.0 if opening is None else float(opening[sample]))
        for name, poses in trajectory.objects.items():
            self.world.move_body(name, poses[sample])

    def hand(self, robot: str) -> np.ndarray:
        """The points (2, 3) of a robot's end effector and of its wrist as shown, world frame."""
        T = self.world.robot(robot).end_effector_pose()
        return transforms.apply(T, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -WRIST]]))

    def shown(self, sample: int) -> set[str]:
        """The bodies that a picture at a sample is about: the goal's object, and those of the contact."""
        contact = contact_at(self.plan, sample)
        names = {self.plan.scene.goal.object}
        if contact is not None:
            names |= {contact.contact_object, contact.manipulator} & set(self.plan.scene.bodies)
        return names


def goal_alone(plan: Plan) -> SimulatedWorld:
    """A world with nothing but the goal's object, at its goal."""
    goal = plan.scene.goal
    body = replace(plan.scene.bodies[goal.object], pose=goal.pose)
    return SimulatedWorld(replace(plan.scene, bodies={goal.object: body}, robots={}))


def points_of(body: Body, inside: float = INSIDE) -> np.ndarray:
    """Points (n, 3) spread over the surface of a body, in its frame.

    Args:
        body: the body.
        inside: share of the way from the middle of each shape to its surface.
    """
    return np.concatenate([_spread(*hull_vertices(shape), inside) for shape in body.shapes])


def corners(points: Iterable[np.ndarray]) -> np.ndarray:
    """Lower and upper corner (2, 3) of the box around arrays (n, 3) of points."""
    joined = np.concatenate(list(points))
    return np.array([joined.min(axis=0), joined.max(axis=0)])


def _spread(vertices: np.ndarray, radius: float, inside: float) -> np.ndarray:
    middle = vertices.mean(axis=0)
    chosen = vertices[np.linspace(0, len(vertices) - 1, min(len(vertices), MOST_POINTS)).round().astype(int)]
    if radius > 0.0:
        around = radius * np.concatenate([np.eye(3), -np.eye(3)])
        chosen = (chosen[:, None, :] + around).reshape(-1, 3)
    return np.concatenate([middle[None], middle + inside * (chosen - middle)])
