"""Build a scene in Python, plan it, and save it as a task file, which ``hmap plan shelf.yaml`` takes."""

import numpy as np

from hmap_core import planner
from hmap_core.exceptions import InputError
from hmap_core.scenes import SceneBuilder

scene = SceneBuilder("shelf", mode="physical")
scene.add_box("table", [2.0, 2.0, 0.1], pose=[0, 0, -0.05])
scene.add_box("shelf", [0.2, 0.3, 0.12], pose=[0.5, 0.3, 0.06])
scene.add_box("box", [0.05, 0.05, 0.08], pose=[0.5, -0.2, 0.04], movable=True, mass=0.3, color=[0.8, 0.3, 0.1, 1])
scene.add_cylinder("can", 0.03, 0.1, pose=[0.5, 0.0, 0.05], movable=True, removable=True, mass=0.2)
scene.add_robot("arm", "panda", base_pose=[0, 0, 0])
scene.add_camera("overhead", position=[-0.3, 0.3, 1.4], look_at=[0.5, 0, 0])
scene.set_goal("box", pose={"xyz": [0.5, 0.25, 0.16], "rpy_deg": [0, 0, 90]}, rotation_tolerance=np.deg2rad(5))

try:
    scene.add_robot("other", "pnda")
except InputError as error:  # what is wrong is told at once, with what is allowed
    print(error)

plan = planner.plan(scene.build(), time_limit=120.0)
print(f"{len(plan.segments)} segments, {plan.trajectory.time[-1]:.1f} s")
scene.save("shelf.yaml")
