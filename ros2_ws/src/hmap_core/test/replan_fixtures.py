"""A brick that is carried along a table, and bodies that come in the way of that."""

from dataclasses import replace

import numpy as np
from planner_fixtures import carry

from hmap_core import planner, transforms
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.conflicts import first_conflict
from hmap_core.planner.interruption import contacts
from hmap_core.simulation.dynamic import sphere

RADIUS = 0.03
ASIDE = -1.2  # rad that the arm is turned at the start, away from where the brick goes
FAR = sphere("ball", RADIUS, np.array([-0.5, 0.5, 0.5]))


def brick_plan(tmp_path_factory):
    """A brick is carried along the table, which is far from everything else."""
    scene = carry(tmp_path_factory.mktemp("carry"), wall=0.001, motion="planar")
    scene = replace(scene, bodies={name: body for name, body in scene.bodies.items() if name != "wall"})
    state = scene.start_state()
    state.q["arm"][0] += ASIDE
    return planner.plan(scene, state=state, seed=1)


def hand(plan, k: int, behind: float = 0.0) -> np.ndarray:
    """A point (3,) of the hand at a sample, so far (m) behind its end effector."""
    arm = plan.scene.robots["arm"]
    tip = load_arm(arm.model).end_effector(plan.trajectory.joints["arm"][k])
    return transforms.apply(transforms.multiply(arm.base_pose, tip), np.array([0.0, 0.0, -behind]))


def with_body(plan, body):
    return replace(plan.scene, bodies=plan.scene.bodies | {body.name: body})


def on_the_way_to_the_contact(plan):
    """A small ball that the hand runs into on its way to the object, and is clear of from then on."""
    made = contacts(plan)[0]
    for share in np.linspace(0.2, 0.8, 13):
        body = sphere("ball", 0.015, hand(plan, int(share * made.begin), behind=0.06))
        before = first_conflict(plan, {"ball": body})
        after = first_conflict(plan, {"ball": body}, plan.trajectory.time[made.begin])
        if before.time > 0.0 and after is None:
            return body
    raise AssertionError("there is no such place")
