"""The node ``world``: the scene under dynamics, with the topics and actions of real hardware."""

import sys
import time

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from hmap.conversions import body_from_message, scene_to_message, state_to_message
from hmap.heartbeats import MOTION_LEASE, Heartbeat
from hmap.naming import Naming
from hmap.node import LATCHED, HmapNode, run
from hmap.supervision.gripper_position import DESCRIPTION, GAP, PARAMETER, GripperPosition
from hmap.world.actions import ControllerActions
from hmap.world.cameras import CameraPublisher
from hmap.world.loop import WorldLoop
from hmap_core.exceptions import Code, InputError
from hmap_core.planner.preconditions import check_bodies
from hmap_core.scenes import load_scene, scene_from_text
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.types import BodyKind, Scene
from hmap_msgs.msg import Scene as SceneMessage
from hmap_msgs.srv import AddBody, GetScene, LoadScene, MoveBody, RemoveBody, Reset
from hmap_msgs_py.poses import pose_from_message, pose_to_message
from hmap_msgs_py.times import time_to_message

FRAME = "world"
DEPTH = 100  # messages that wait for a recorder, which may lag when the simulation is fast
MOVED = 0.003  # m or rad; smallest motion after which a new picture is taken


class WorldNode(HmapNode):
    """Simulates a scene."""

    def __init__(self):
        super().__init__("world")
        self._naming = Naming(self, "arm_joint", "finger_joint", "arm_action", "gripper_action", "camera", "body_pose")
        task = self.parameter("task", "tunnel", "task that is loaded at the start: a name, or the path of a task file")
        seed = self.parameter("seed", 0, "of its randomisation", 0, 2**31 - 1)
        speed = self.parameter(
            "real_time_factor", 4.0, "simulated s per s while a robot moves; 0: as fast as possible", 0.0, 1000.0
        )
        idle = self.parameter("idle_real_time_factor", 1.0, "the same while no robot moves", 0.1, 1000.0)
        rates = {
            "clock": self.parameter("clock_rate", 20.0, "of /clock at least, Hz", 1.0, 1000.0),
            "joints": self.parameter("joint_state_rate", 20.0, "of joint_states at least, Hz", 1.0, 1000.0),
            "poses": self.parameter("body_pose_rate", 20.0, "of the bodies' poses at least, Hz", 1.0, 1000.0),
        }
        # s of real and of simulated time; with equal ones all are due together, so that one message of the clock does
        self._periods = {what: 1.0 / rate for what, rate in rates.items()}
        self._camera_period = self.parameter(
            "camera_period", 4.0, "simulated s between pictures, taken when something has moved; 0: on demand", 0.0, 1e6
        )
        self._gripper_position = GripperPosition(self.parameter(PARAMETER, GAP, DESCRIPTION))
        about = "whether bodies of the service add_body are in `scene`; false: only cameras see them"
        self._announce = self.parameter("announce_added", True, about)
        self._clock_topic = self.create_publisher(Clock, "clock", 10)
        self._joints = self.create_publisher(JointState, "joint_states", DEPTH)
        self._scene = self.create_publisher(SceneMessage, "scene", LATCHED)
        self._last: dict[tuple[str, str], float] = {}
        self._pictured: np.ndarray | None = None
        self._actions: dict[str, ControllerActions] = {}
        self._poses: dict[str, Publisher] = {}
        self._cameras: dict[str, CameraPublisher] = {}
        self._loop = WorldLoop(_checked(load_scene(task, seed)), speed, idle, self._publish)
        self._offer_scene()
        self.serve(LoadScene, "load_scene", self._load)
        self.serve(Reset, "reset", lambda request, response: self._reload(self._loaded))
        self.serve(GetScene, "get_scene", lambda request, response: self._describe(response))
        self.serve(AddBody, "add_body", self._add)
        self.serve(MoveBody, "move_body", self._move)
        self.serve(RemoveBody, "remove_body", self._remove)
        self.create_service(Trigger, "take_pictures", self._take_pictures, callback_group=self.group)
        self._supervisor = Heartbeat(self, "supervisor", self.group, self._stop_arms, MOTION_LEASE)
        self._loop.start()

    def close(self) -> None:
        """Stop the simulation."""
        super().close()
        self._loop.stop()

    def _stop_arms(self) -> None:
        """Nothing moves without the supervisor that sent it."""
        if self.stopping.is_set():
            return
        moving = self._loop.stop_arms()
        if moving:
            self.get_logger().warning(f"the supervisor has died; stopped: {', '.join(moving)}")

    # services

    def _load(self, request, response) -> None:
        if request.text:
            scene = _checked(scene_from_text(request.text))
        else:
            scene = _checked(load_scene(request.task, int(request.seed)))
        self._reload(scene)
        self._describe(response)

    def _reload(self, scene: Scene) -> None:
        self._loop.call(lambda: self._loop.load(scene))
        self._offer_scene()

    def _describe(self, response) -> None:
        scene, state = self._loop.call(lambda: (self._loop.scene, self._loop.world.state()))
        response.scene = scene_to_message(scene)
        response.world = state_to_message(scene, state, time_to_message(self._loop.world.time))

    def _add(self, request, response) -> None:
        body = body_from_message(request.body)
        self._loop.call(lambda: self._loop.add(body))
        self._bodies_changed()

    def _move(self, request, response) -> None:
        pose = pose_from_message(request.pose)
        self._loop.call(lambda: self._loop.move(request.name, pose))
        self._bodies_changed()

    def _remove(self, request, response) -> None:
        if request.name not in self._loop.scene.bodies:
            known = ", ".join(self._loop.scene.bodies)
            raise InputError(f"no body {request.name!r} in the world; there are: {known}", Code.UNKNOWN_OBJECT)
        self._loop.call(lambda: self._loop.remove(request.name))
        self._bodies_changed()

    def _bodies_changed(self) -> None:
        """Announce the bodies, or take pictures at once so that the cameras see them."""
        self._offer_bodies()
        if not self._announce:
            self._loop.call(lambda: self._picture(self._loop.world))

    def _take_pictures(self, request, response):
        try:
            self._loop.call(lambda: self._picture(self._loop.world))
            response.success = True
        except Exception as error:  # the response has the reason
            response.message = str(error)
        return response

    # servers and topics of the current scene

    def _offer_scene(self) -> None:
        """Make servers and topics for a newly loaded scene."""
        scene = self._loaded = self._loop.scene
        for name in list(self._actions):
            self._actions.pop(name).destroy()
        if self._cameras:  # between two pictures, because the simulation thread takes them
            self._loop.call(self._destroy_cameras)
        self._actions = {
            name: ControllerActions(self, self._loop, self._naming, robot, self._gripper_position)
            for name, robot in scene.robots.items()
        }
        self._cameras = {
            name: CameraPublisher(self, camera, self._naming.camera(name)) for name, camera in scene.cameras.items()
        }
        self._pictured = None
        self._offer_bodies()
        self.set_status("simulating", task=scene.task, seed=scene.seed)

    def _destroy_cameras(self) -> None:
        for name in list(self._cameras):
            self._cameras.pop(name).destroy()

    def _offer_bodies(self) -> None:
        scene = self._loop.scene
        movable = [body.name for body in scene.bodies.values() if body.kind is not BodyKind.FIXED]
        gone = [self._poses.pop(name) for name in list(self._poses) if name not in movable]
        if gone:  # between two steps, because the simulation thread publishes
            self._loop.call(lambda: [self.destroy_publisher(publisher) for publisher in gone])
        for name in movable:
            if name not in self._poses:
                self._poses[name] = self.create_publisher(PoseStamped, self._naming.body_pose(name), DEPTH)
        self._scene.publish(scene_to_message(scene if self._announce else self._loop.scene_without_added()))

    # in the simulation thread

    def _publish(self, world: SimulatedWorld) -> None:
        if self.stopping.is_set():
            return
        stamp = time_to_message(world.time)
        clock, joints, poses = (self._due(what, world) for what in ("clock", "joints", "poses"))
        if clock or joints or poses:  # no stamp is ahead of the clock
            self._clock_topic.publish(Clock(clock=stamp))
        if joints:
            self._joints.publish(self._joint_state(world, stamp))
        if poses:
            self._publish_poses(world, stamp)
        if self._camera_period > 0.0 and self._passed("pictures", "simulated", world.time, self._camera_period):
            if self._pictured is None or np.abs(self._configuration(world) - self._pictured).max() > MOVED:
                self._picture(world)

    def _due(self, what: str, world: SimulatedWorld) -> bool:
        """Whether a period has passed: of real time, for who waits, or of simulated time, for who reads the bag."""
        period, clocks = self._periods[what], {"real": time.monotonic(), "simulated": world.time}
        passed = {clock: self._passed(what, clock, now, period) for clock, now in clocks.items()}
        if not any(passed.values()):
            return False
        # the other clock's period begins anew, too: one message serves both
        self._last |= {(what, clock): clocks[clock] for clock, it_passed in passed.items() if not it_passed}
        return True

    def _passed(self, what: str, clock: str, now: float, period: float) -> bool:
        last = self._last.get((what, clock), -np.inf)
        if last <= now < last + period:
            return False
        # a late one shortens the next period, by one period at most; a clock that went back begins anew
        self._last[what, clock] = min(now, max(last + period, now - period))
        return True

    def _joint_state(self, world: SimulatedWorld, stamp: Time) -> JointState:
        message = JointState(header=Header(stamp=stamp))
        for name, states in world.joint_states().items():
            model = self._loop.scene.robots[name].model
            message.name.extend(self._naming.arm_joints(name, model) + self._naming.finger_joints(name, model))
            message.position.extend(states.positions.tolist())
            message.velocity.extend(states.velocities.tolist())
            message.effort.extend(states.efforts.tolist())
        return message

    def _publish_poses(self, world: SimulatedWorld, stamp: Time) -> None:
        for name, body in self._loop.scene.bodies.items():
            if body.kind is not BodyKind.FIXED and name in self._poses:
                pose = pose_to_message(world.body_pose(name))
                self._poses[name].publish(PoseStamped(header=Header(stamp=stamp, frame_id=FRAME), pose=pose))

    def _picture(self, world: SimulatedWorld) -> None:
        self._pictured = self._configuration(world)
        self._clock_topic.publish(Clock(clock=time_to_message(world.time)))
        for name, publisher in list(self._cameras.items()):
            publisher.publish(world.render(name), time_to_message(world.time))

    def _configuration(self, world: SimulatedWorld) -> np.ndarray:
        state = world.state()
        movable = [state.poses[n] for n, body in self._loop.scene.bodies.items() if body.kind is not BodyKind.FIXED]
        configuration = np.concatenate([*movable, *state.q.values()])
        if self._pictured is not None and self._pictured.shape != configuration.shape:
            self._pictured = np.full_like(configuration, np.inf)  # a body was added or removed
        return configuration


def _checked(scene: Scene) -> Scene:
    """Return the scene if its bodies can be at their start poses.

    Raises:
        InputError: they cannot.
    """
    check_bodies(scene, scene.goal)
    return scene


def main(args: list[str] | None = None) -> int:
    """Run the node; the exit code."""
    return run(WorldNode, args)


if __name__ == "__main__":
    sys.exit(main())
