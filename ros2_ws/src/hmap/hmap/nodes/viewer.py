"""The node ``viewer``: the live page in a browser, with what the graph thinks and buttons for it."""

import json
import sys

from action_msgs.srv import CancelGoal
from std_msgs.msg import String

from hmap.conversions import clouds_in_world, plan_from_message, scene_from_message, state_from_message
from hmap.node import LATCHED, HmapNode, run
from hmap.operator_client import OperatorClient
from hmap.session import Session
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.scenes.tasks import list_tasks
from hmap_core.types import Scene
from hmap_core.viewer.page import Page
from hmap_core.viewer.server import LOCALHOST, PORT, address, open_server
from hmap_msgs.msg import ObjectClouds, PlannerStatus, WorldState
from hmap_msgs.msg import Plan as PlanMessage
from hmap_msgs.msg import Scene as SceneMessage
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.times import seconds_from_message

REFRESH = 0.5  # s between two looks at who offers what


class Viewer(HmapNode):
    """Shows the graph, and implements :class:`hmap_core.viewer.commands.Commands`.

    Raises:
        InputError: the page cannot be opened at this address.
    """

    def __init__(self):
        super().__init__("viewer")
        text = "address at which the page is offered; others than 127.0.0.1 let other machines move the robots"
        host = self.parameter("host", LOCALHOST, text)
        port = self.parameter("port", PORT, "of the page; the next free one from it", 0, 2**16 - 1)
        self._session = Session(node=self)
        self._scene: Scene | None = None
        self._told = True  # whether the end of the goal was told
        self._seed = 0
        self._operator = OperatorClient(self)
        self._cancels = self.create_client(CancelGoal, "manipulate/_action/cancel_goal", callback_group=self.group)
        self._page = Page(open_server(host, port), self)
        self.subscribe(SceneMessage, "scene", self._take_scene, LATCHED)
        self.subscribe(WorldState, "world_state", self._take_state, 1)
        self.subscribe(PlanMessage, "plan", self._take_plan, LATCHED)
        self.subscribe(PlannerStatus, "planner_status", self._take_status, LATCHED)
        self.subscribe(ObjectClouds, "object_clouds", self._take_clouds, LATCHED)
        self.subscribe(String, "search_tree", self._take_search, LATCHED)
        self.every(REFRESH, self._refresh)
        self.set_status(f"page at {address(self._page.server)}")
        self.get_logger().info(f"page at {address(self._page.server)}")

    def close(self) -> None:
        """Close the page; the goal that it gave goes on."""
        super().close()
        self._page.close()

    # the graph

    def _take_scene(self, message: SceneMessage) -> None:
        self._scene = scene_from_message(message)
        self._page.set_scene(self._scene)

    def _take_state(self, message: WorldState) -> None:
        scene = self._scene
        if scene is None or (message.task, int(message.seed)) != (scene.task, scene.seed):
            return
        if {body.name for body in message.bodies} == set(scene.bodies):  # else `scene` has not come yet
            self._page.add_state(seconds_from_message(message.header.stamp), state_from_message(scene, message))

    def _take_plan(self, message: PlanMessage) -> None:
        self._page.set_plan(plan_from_message(message))

    def _take_status(self, message: PlannerStatus) -> None:
        self._page.set_status(
            message.phase, message.text, int(message.waypoint), int(message.waypoint_count), int(message.attempt)
        )

    def _take_clouds(self, message: ObjectClouds) -> None:
        self._page.set_clouds(clouds_in_world(message))

    def _take_search(self, message: String) -> None:
        search = json.loads(message.data)
        if not isinstance(search, dict):
            raise ConversionError("search_tree has no JSON object")
        self._page.set_search(search)

    def _refresh(self) -> None:
        self._page.refresh()
        if not self._told and self._session.is_done():
            self._told = True
            result = self._session.result()
            self._page.tell("the goal is reached" if result.success else str(result.error))

    # what the page asks for

    def tasks(self) -> list[str]:
        """Names of the tasks that come with hmap."""
        return list_tasks(unsolvable=False)

    def available(self) -> set[str]:
        """What the supervisor offers now."""
        return self._operator.available()

    def start(self, task: str, seed: int, plan_only: bool) -> None:
        """Give the goal of a task."""
        self._seed = seed
        self._session.manipulate(task, seed=seed, plan_only=plan_only)
        self._told = False

    def replan(self) -> None:
        """Give the goal of the loaded scene again, with another seed of the planner; it takes the place of the old.

        Raises:
            InputError: no scene is loaded.
            PlannerError: SERVICE_UNAVAILABLE; there is no supervisor.
        """
        if self._scene is None:
            raise InputError("no scene is loaded yet")
        self._seed += 1
        self._session.manipulate(seed=self._seed)
        self._told = False

    def cancel(self) -> None:
        """Ask for the end of all goals, whoever gave them.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE; there is no supervisor.
        """
        if not self._cancels.service_is_ready():
            raise PlannerError("no supervisor is there", Code.SERVICE_UNAVAILABLE)
        self._cancels.call_async(CancelGoal.Request())  # without a goal's number: all

    def call(self, name: str) -> str:
        """Call a service of the supervisor; its answer. Raises PlannerError where nobody answers."""
        return self._operator.call(name)[1]

    def set_speed(self, share: float) -> None:
        """Scale the speed of motions."""
        self._operator.scale_speed(share)


def main(args: list[str] | None = None) -> int:
    """Run the node; its exit code."""
    return run(Viewer, args)


if __name__ == "__main__":
    sys.exit(main())
