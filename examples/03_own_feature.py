"""Write a feature for KOMO: the hand looks at a point while it moves. It is a CasADi expression, compiled once."""

import numpy as np

from hmap_core.komo.features import symbolic_feature
from hmap_core.komo.objective import ObjectiveType
from hmap_core.komo.skeleton import Skeleton, SkeletonEntry
from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.komo.workspace import Workspace
from hmap_core.scenes import SceneBuilder

POINT = np.array([0.6, 0.0, 0.1])  # m, world


def aside(frames, params):
    """How far a point in the world, ``params``, is from the z axis of a frame: (2,) in m, along its x and y axes."""
    (hand,) = frames
    return (hand.rotation.T @ (params - hand.position))[:2]


scene = SceneBuilder("look").add_robot("arm", "panda")
scene.add_box("table", [2, 2, 0.1], [0, 0, -0.05]).add_box("box", [0.05] * 3, [0.6, 0, 0.1], movable=True, mass=0.1)
workspace = Workspace(scene.set_goal("box", [0.6, 0, 0.1]).build(), robots=["arm"])

skeleton = Skeleton([SkeletonEntry(1, 1, "position_eq", ("arm",), np.array([0.35, 0.35, 0.45]))])
problem = SkeletonProblem(skeleton, workspace, steps_per_phase=20)
look_at = symbolic_feature("look at", aside, (workspace.model.tip("arm"),), POINT, unit="m")
problem.add_objective(look_at, ObjectiveType.EQ, (0.5, 1.0))  # in the second half of the motion

result = problem.solve(workspace.start)
print(f"feasible: {result.feasible}, {len(result.path)} steps")
