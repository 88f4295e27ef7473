"""Worlds of arms and free bodies, and the value and derivative of a feature in them, as the solver calls it."""

import ctypes

import numpy as np
from core_fixtures import arm, frames, random_q
from scipy.spatial.transform import Rotation

from hmap_core.kinematics import FreeBody, Freedom, KinematicModel, PlacedArm
from hmap_core.kinematics.tree import forward
from hmap_core.transforms import from_rpy, pose

KERNEL_TYPE = ctypes.CFUNCTYPE(None, ctypes.c_int64, *[ctypes.c_void_p] * 9)
# A central difference is off by h^2 / 6 of the third derivative, below 10 here, and by about 1e-15 / h of rounding.
STEP = 1e-6  # rad, m
BOUND = 1e-8
SIZE = 2.0  # m a free body may go each way
WORLDS = (("panda",), ("iiwa",), ("planar", "spatial"), ("iiwa", "panda", "spatial"))


def world_of(*names: str) -> KinematicModel:
    """Arms and free bodies 60 cm apart, each turned and tilted another way, named by their kind and number."""
    parts = []
    for k, name in enumerate(names):
        base = from_rpy((0.6 * k, 0.1 * k, 0.2), (0.1 * k, -0.2 * k, 0.7 - k))
        if name in tuple(Freedom):
            size = SIZE * np.ones(2 if name == Freedom.PLANAR else 3)
            resting = from_rpy((0.02, 0.0, 0.05), (0.3, 0.0, 0.1))
            parts.append(FreeBody(f"{name}_{k}", Freedom(name), base, -size, size, 0.3, resting))
        else:
            parts.append(PlacedArm(f"{name}_{k}", arm(name), base))
    return KinematicModel(parts)


def frame_pose(chain, q, frame: int) -> np.ndarray:
    """T_world_frame (7,) at the configuration q (n,)."""
    R, p = frames(chain, q)
    return pose(p[frame], Rotation.from_matrix(R[frame]).as_quat())


def evaluate(feature, chain, q):
    """Value (dim,) and Jacobian (dim, n), as the solver calls the kernel."""
    n = len(q)
    R, p = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    forward(np.array(q, float), chain.parent, chain.R_joint, chain.p_joint, chain.prismatic, R, p)
    r, J = np.zeros(feature.dim), np.zeros((feature.dim, n))
    arrays = (R, p, chain.first, chain.prismatic, np.array(q, float), np.array([*feature.frames, 0], np.int64),
              np.array([*feature.params, 0.0]), r, J)  # fmt: skip
    KERNEL_TYPE(feature.kernel)(n, *(a.ctypes.data for a in arrays))
    return r, J


def differences(feature, chain, q):
    """The Jacobian (dim, n) by central differences."""
    columns = []
    for step in STEP * np.eye(len(q)):
        columns.append((evaluate(feature, chain, q + step)[0] - evaluate(feature, chain, q - step)[0]) / (2 * STEP))
    return np.array(columns).T


def assert_derivative(feature, chain, q, bound=BOUND):
    """The Jacobian is that of central differences, to within the bound."""
    _, J = evaluate(feature, chain, q)
    np.testing.assert_allclose(J, differences(feature, chain, q), rtol=0.0, atol=bound, err_msg=feature.name)


def configurations(chain, rng):
    """Random ones, and near-singular ones: stretched, at the limits, and half-way round."""
    n = len(chain.lower)
    yield from (random_q(chain, rng) for _ in range(4))
    yield np.zeros(n)
    yield 1e-7 * rng.normal(size=n)
    yield chain.lower.copy()
    yield np.where(np.arange(n) % 2, chain.upper, 0.0)
