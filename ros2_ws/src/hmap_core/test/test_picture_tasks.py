"""Every task and every example is drawn, and its picture shows the object where it is, and where it has to go."""

from pathlib import Path

import numpy as np
import pytest

from hmap_core import transforms
from hmap_core.scenes import list_tasks, load_scene
from hmap_core.types import Plan, Scene, Segment, SegmentKind, Trajectory
from hmap_core.viz.key_frames import key_samples
from hmap_core.viz.picture import draw
from hmap_core.viz.stage import Stage, goal_alone
from hmap_core.viz.view import camera_for

EXAMPLES = sorted((Path(__file__).parents[4] / "docs" / "examples").glob("*.yaml"))
TASKS = [*list_tasks(), *map(str, EXAMPLES)]
WIDTH, HEIGHT = 96, 72
SAMPLES = 21
SHARE = 0.2  # of what would be seen of the object without anything else


def straight(scene: Scene) -> Plan:
    """The object goes straight to its goal while the robots stand: where things are is all that a picture needs."""
    time = 0.1 * np.arange(SAMPLES)
    name, (robot, *_) = scene.goal.object, scene.robots.values()
    start, goal = scene.bodies[name].pose, scene.goal.pose
    state = scene.start_state()
    trajectory = Trajectory(
        time=time,
        joints={key: np.repeat(q[None], SAMPLES, axis=0) for key, q in state.q.items()},
        gripper={key: np.full(SAMPLES, opening) for key, opening in state.gripper.items()},
        objects={name: np.array([transforms.interpolate(start, goal, s) for s in np.linspace(0.0, 1.0, SAMPLES)])},
    )
    hand = robot.model.end_effector_link
    kinds = [(0.0, 0.4, SegmentKind.TRANSIT), (0.4, 1.6, SegmentKind.GRASP), (1.6, 2.0, SegmentKind.TRANSIT)]
    segments = [
        Segment(begin, end, robot.name, hand, None if kind is SegmentKind.TRANSIT else name, kind)
        for begin, end, kind in kinds
    ]
    return Plan(scene, trajectory, tuple(segments), np.array([start, goal]), {})


@pytest.mark.parametrize("task", TASKS)
def test_every_task_is_drawn_with_its_object_and_its_goal(task):
    plan = straight(load_scene(task, seed=0))
    samples = key_samples(plan)
    camera = camera_for(plan, WIDTH, HEIGHT, samples)
    picture = draw(plan, WIDTH, HEIGHT)
    assert picture.dtype == np.uint8 and picture.std() > 5.0
    with Stage(plan) as stage, goal_alone(plan) as alone:
        name = plan.scene.goal.object
        shares = []
        for k in samples:
            stage.show(k)
            alone.move_body(name, stage.world.body_pose(name))
            unhidden = (alone.render(camera).mask > 0).sum()
            image = stage.world.render(camera)
            number = next(i for i, other in image.names.items() if other == name)
            shares.append((image.mask == number).sum() / unhidden)
            assert unhidden > 0
        alone.move_body(name, plan.scene.goal.pose)
        assert (alone.render(camera).mask > 0).sum() > 0
    assert np.median(shares) > SHARE
