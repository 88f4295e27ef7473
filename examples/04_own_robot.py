"""Use a robot of your own: a YAML file beside its URDF says what the URDF does not (``robots/my_iiwa.yaml``)."""

from pathlib import Path

import numpy as np

from hmap_core import planner
from hmap_core.scenes import SceneBuilder, load_robot_model

ROBOT = Path(__file__).parent / "robots" / "my_iiwa.yaml"

model = load_robot_model(str(ROBOT))
print(f"{model.name}: {len(model.joint_names)} joints, {'a' if model.gripper else 'no'} gripper")

# A bare flange cannot grip: in a kinematic task, what it touches goes with it.
scene = SceneBuilder("carry", mode="kinematic").add_robot("arm", ROBOT, base_pose=[0, 0, 0])
scene.add_box("table", [2, 2, 0.1], [0, 0, -0.05]).add_box("wall", [0.3, 0.02, 0.1], [0.55, 0.0, 0.05])
scene.add_box("box", [0.1, 0.1, 0.1], [0.55, -0.2, 0.05], movable=True, mass=0.5)
scene.set_goal("box", [0.55, 0.2, 0.05], rotation_tolerance=np.pi)

plan = planner.plan(scene.build(), time_limit=240.0)
print(
    f"{len(plan.segments)} segments; the joints move by up to {np.ptp(plan.trajectory.joints['arm'], 0).max():.1f} rad"
)
