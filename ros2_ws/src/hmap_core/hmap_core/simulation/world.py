"""The simulated world: everything of a scene under gravity, friction and joint forces."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.simulation import bodies, camera
from hmap_core.simulation.bodies import BodyHandle
from hmap_core.simulation.camera import CameraImage
from hmap_core.simulation.client import BulletClient
from hmap_core.simulation.robots import JointStates, SimulatedRobot
from hmap_core.simulation.settings import GRAVITY, SOLVER_ITERATIONS, TIME_STEP
from hmap_core.types import Body, Camera, Scene, SceneState

MAX_RAYS = 10_000  # at once; PyBullet allows 16384
QUATERNION_TOLERANCE = 1e-3  # how far the norm of a given quaternion may be from 1


@dataclass(frozen=True)
class Contact:
    """Two things touching at a point.

    Attributes:
        a, b: names of a body or robot.
        link_a, link_b: names of the robot links; empty for bodies.
        position: (3,) on ``b``, world, m.
        normal: (3,) unit, from ``b`` towards ``a``.
        distance: m, negative when they penetrate.
        force: N along the normal.
    """

    a: str
    link_a: str
    b: str
    link_b: str
    position: np.ndarray
    normal: np.ndarray
    distance: float
    force: float


class SimulatedWorld:
    """A scene under dynamics. Objects move by contact and gravity only, but for :meth:`reset` and :meth:`move_body`."""

    dt = TIME_STEP

    def __init__(self, scene: Scene):
        """Build the scene in its own physics server, at its start state.

        Raises:
            InputError: a body or a robot cannot be simulated, or a body and a robot share a name.
        """
        self.scene = scene
        self._client = BulletClient()
        self._meshes = tempfile.TemporaryDirectory(prefix="hmap_meshes_")
        self._steps = 0
        self._numbers: dict[str, int] = {}
        self._build(scene)

    def __enter__(self) -> "SimulatedWorld":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Free the physics server; the world cannot be used afterwards."""
        self._client.close()
        self._meshes.cleanup()

    @property
    def time(self) -> float:
        """Simulated seconds since the world was made; goes on through resets."""
        return self._steps * TIME_STEP

    def step(self) -> None:
        """Let ``dt`` pass."""
        for robot in self._robots.values():
            robot.renew_contacts()
        self._client.stepSimulation()
        self._steps += 1

    # robots

    def joint_states(self) -> dict[str, JointStates]:
        """Robot -> its measured joints."""
        return {name: robot.joint_states() for name, robot in self._robots.items()}

    def robot(self, name: str) -> SimulatedRobot:
        """The robot of that name.

        Raises:
            InputError: there is none.
        """
        if name not in self._robots:
            raise InputError(f"no robot '{name}' in the world; there are {sorted(self._robots)}", Code.UNKNOWN_ROBOT)
        return self._robots[name]

    def set_joint_targets(self, robot: str, q: np.ndarray, qd: np.ndarray, effort: np.ndarray | None = None) -> None:
        """Where the arm's motors go: positions (n,) rad, velocities (n,) rad/s, and efforts (n,) N m to press with."""
        self.robot(robot).set_joint_targets(q, qd, effort)

    def set_gripper(self, robot: str, opening: float, force: float) -> None:
        """Where the fingers go: gap between the pads in metres, with at most ``force`` newtons each."""
        self.robot(robot).set_gripper(opening, force)

    # bodies

    def body_pose(self, name: str) -> np.ndarray:
        """``T_world_body`` (7,)."""
        return bodies.pose_of(self._client, self._body(name))

    def body_velocity(self, name: str) -> np.ndarray:
        """Velocity of the body's origin (m/s), angular velocity (rad/s): (6,), world axes."""
        return bodies.velocity_of(self._client, self._body(name))

    def body_names(self) -> list[str]:
        """Names of all bodies at present."""
        return list(self._bodies)

    def body(self, name: str) -> Body:
        """The body as described, at its present pose."""
        return replace(self._body(name).body, pose=self.body_pose(name))

    def add_body(self, body: Body) -> None:
        """Put one more body into the world, until the next reset.

        Raises:
            InputError: the name is taken, the pose is no pose, or the shapes cannot be made.
        """
        if body.name in self._bodies or body.name in self._robots:
            raise InputError(f"the name '{body.name}' is taken", Code.INVALID_SCENE)
        checked_pose(body.pose, f"body '{body.name}'")
        handle = bodies.create(self._client, body, Path(self._meshes.name))
        self._bodies[body.name] = handle
        self._numbers.setdefault(body.name, len(self._numbers) + 1)

    def move_body(self, name: str, pose: np.ndarray) -> None:
        """Put a body (fixed or movable) at ``T_world_body`` (7,), at rest."""
        handle = self._body(name)
        bodies.place(self._client, handle, checked_pose(pose, f"body '{name}'"))

    def remove_body(self, name: str) -> None:
        """Take a body out of the world, until the next reset."""
        self._client.removeBody(self._body(name).id)
        del self._bodies[name]

    # the whole

    def state(self) -> SceneState:
        """Where everything is now."""
        return SceneState(
            q={name: robot.arm_state()[0] for name, robot in self._robots.items()},
            gripper={name: robot.gripper_state()[0] for name, robot in self._robots.items()},
            poses={name: self.body_pose(name) for name in self._bodies},
        )

    def reset(self, target: Scene | SceneState | None = None) -> None:
        """Start afresh: at the start of this scene, at a state of this scene, or with another scene. All at rest.

        Raises:
            InputError: the state names a robot or body that is not in the scene, or has a malformed pose.
        """
        if isinstance(target, Scene):
            self.scene = target
        state = target if isinstance(target, SceneState) else self.scene.start_state()
        self._check_state(state)
        self._build(self.scene)
        for name, pose in state.poses.items():
            self.move_body(name, pose)
        for name, q in state.q.items():
            self._robots[name].place(q, state.gripper.get(name, 0.0))

    def contacts(self, name: str | None = None) -> list[Contact]:
        """Contacts at the last step; of one body or robot, or all.

        Raises:
            InputError: no body or robot has that name.
        """
        chosen = {} if name is None else {"bodyA": self._id(name)}
        names: dict[int, tuple[str, SimulatedRobot | None]] = {
            handle.id: (body, None) for body, handle in self._bodies.items()
        }
        names |= {robot.id: (key, robot) for key, robot in self._robots.items()}
        return [_contact(point, names) for point in self._client.getContactPoints(**chosen) or ()]

    def first_hits(self, origin: np.ndarray, targets: np.ndarray) -> list[str]:
        """Casts rays against the collision shapes.

        Args:
            origin: (3,) m, world frame.
            targets: (n, 3) m, the ends of the rays.

        Returns:
            The name of the body or robot that each ray meets first; empty where it meets nothing.
        """
        names = {handle.id: name for name, handle in self._bodies.items()}
        names |= {robot.id: name for name, robot in self._robots.items()}
        self._client.performCollisionDetection()  # what was placed since the last step is found where it is now
        hits = []
        for begin in range(0, len(targets), MAX_RAYS):
            ends = np.asarray(targets[begin : begin + MAX_RAYS], float)
            starts = np.broadcast_to(np.asarray(origin, float), ends.shape)
            hits += [names.get(hit[0], "") for hit in self._client.rayTestBatch(starts.tolist(), ends.tolist())]
        return hits

    def render(self, view: Camera | str) -> CameraImage:
        """A picture by a camera, or by the scene's camera of that name.

        Raises:
            InputError: the scene has no camera of that name.
        """
        if isinstance(view, str):
            if view not in self.scene.cameras:
                raise InputError(f"no camera '{view}' in the scene; there are {sorted(self.scene.cameras)}")
            view = self.scene.cameras[view]
        things = {name: handle.id for name, handle in self._bodies.items()}
        things |= {name: robot.id for name, robot in self._robots.items()}
        return camera.render(self._client, view, {i: (self._numbers[name], name) for name, i in things.items()})

    def _build(self, scene: Scene) -> None:
        shared = sorted(scene.bodies.keys() & scene.robots.keys())
        if shared:
            raise InputError(f"robots and bodies share the names {shared}", Code.INVALID_SCENE)
        self._client.resetSimulation()
        self._client.setGravity(0.0, 0.0, -GRAVITY)
        self._client.setPhysicsEngineParameter(
            fixedTimeStep=TIME_STEP, numSolverIterations=SOLVER_ITERATIONS, deterministicOverlappingPairs=1
        )
        self._bodies: dict[str, BodyHandle] = {}
        self._robots: dict[str, SimulatedRobot] = {}
        for body in scene.bodies.values():
            self.add_body(body)
        for name, robot in scene.robots.items():
            self._robots[name] = SimulatedRobot(self._client, robot)
            self._numbers.setdefault(name, len(self._numbers) + 1)

    def _check_state(self, state: SceneState) -> None:
        for name, pose in state.poses.items():
            if name not in self.scene.bodies:
                raise InputError(f"no body '{name}' in the scene", Code.UNKNOWN_OBJECT)
            checked_pose(pose, f"body '{name}'")
        for name in state.q.keys() | state.gripper.keys():
            if name not in self.scene.robots:
                raise InputError(f"no robot '{name}' in the scene", Code.UNKNOWN_ROBOT)

    def _body(self, name: str) -> BodyHandle:
        if name not in self._bodies:
            raise InputError(f"no body '{name}' in the world; there are {sorted(self._bodies)}", Code.UNKNOWN_OBJECT)
        return self._bodies[name]

    def _id(self, name: str) -> int:
        return self._robots[name].id if name in self._robots else self._body(name).id


def checked_pose(pose: np.ndarray, whose: str) -> np.ndarray:
    """The pose (7,) with its quaternion normalised.

    Raises:
        InputError: wrong shape, not finite, or a quaternion that is not close to a unit one.
    """
    pose = np.asarray(pose, float)
    if pose.shape != (7,) or not np.isfinite(pose).all():
        raise InputError(f"the pose of {whose} is {pose}; 7 finite numbers are needed", Code.INVALID_POSE)
    norm = np.linalg.norm(pose[3:])
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        raise InputError(f"the quaternion of {whose} has norm {norm:.6g}; it has to be 1", Code.INVALID_POSE)
    return np.concatenate([pose[:3], pose[3:] / norm])


def _contact(point: tuple, names: dict[int, tuple[str, SimulatedRobot | None]]) -> Contact:
    a, robot_a = names[point[1]]
    b, robot_b = names[point[2]]
    return Contact(
        a=a,
        link_a=robot_a.link_name(point[3]) if robot_a else "",
        b=b,
        link_b=robot_b.link_name(point[4]) if robot_b else "",
        position=np.array(point[6]),
        normal=np.array(point[7]),
        distance=float(point[8]),
        force=float(point[9]),
    )
