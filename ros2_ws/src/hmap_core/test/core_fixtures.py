"""Random shapes and placed arms for tests of collision, kinematics and KOMO."""

from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from hmap_core.collision.convex import ConvexSet, from_hulls
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.kinematics.model import KinematicModel, PlacedArm
from hmap_core.scenes import load_robot_model
from hmap_core.transforms import from_rpy, pose

KINDS = ("box", "sphere", "capsule", "hull")


def random_pose(rng, spread) -> np.ndarray:
    return pose(rng.uniform(-spread, spread, 3), rng.normal(size=4))


def random_hull(rng, kind) -> tuple[np.ndarray, float]:
    """Vertices (n, 3) and radius of a shape between 2 and 40 cm in size."""
    size = rng.uniform(0.02, 0.4, 3)
    if kind == "box":
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
        return signs * size / 2, 0.0
    if kind == "sphere":
        return np.zeros((1, 3)), float(size[0] / 2)
    if kind == "capsule":
        return np.array([[0, 0, -size[0] / 2], [0, 0, size[0] / 2]]), float(size[1] / 4)
    points = rng.normal(size=(int(rng.integers(8, 60)), 3))
    points = points / np.linalg.norm(points, axis=1, keepdims=True) * size / 2
    return np.ascontiguousarray(points[ConvexHull(points).vertices]), 0.0


def single(hull) -> ConvexSet:
    return from_hulls([hull])


@lru_cache
def arm(name: str) -> Arm:
    return load_arm(load_robot_model(name))


def model(*names: str) -> KinematicModel:
    """Arms 60 cm apart, each turned and tilted another way."""
    bases = [from_rpy((0.6 * k, 0.1 * k, 0.2), (0.1 * k, -0.2 * k, 0.7 - k)) for k in range(len(names))]
    return KinematicModel([PlacedArm(f"{n}_{k}", arm(n), b) for k, (n, b) in enumerate(zip(names, bases, strict=True))])


def random_q(chain, rng) -> np.ndarray:
    return rng.uniform(chain.lower, chain.upper)


def frames(chain, q) -> tuple[np.ndarray, np.ndarray]:
    """World rotations (n + 1, 3, 3) and origins (n + 1, 3) by a plain product of transforms."""
    R, p = [np.eye(3)], [np.zeros(3)]
    for k in range(len(q)):
        a = chain.parent[k]
        turn, slide = (0.0, q[k]) if chain.prismatic[k] else (q[k], 0.0)
        R_joint = chain.R_joint[k]
        p.append(p[a] + R[a] @ (chain.p_joint[k] + R_joint[:, 2] * slide))
        R.append(R[a] @ R_joint @ Rotation.from_rotvec([0, 0, turn]).as_matrix())
    return np.array(R), np.array(p)


def no_collisions() -> CollisionModel:
    """A model with one shape and no pairs."""
    scene = CollisionModel()
    scene.add("nothing", np.zeros((1, 3)), 0.0, 0)
    return scene
