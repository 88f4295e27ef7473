"""rclpy's action client, made safe for use from other threads than the executor's."""

import threading

from rclpy.action import ActionClient as RclpyActionClient
from rclpy.action.client import ClientGoalHandle
from unique_identifier_msgs.msg import UUID


class ActionClient(RclpyActionClient):
    """An action client without rclpy's race between requests and responses.

    rclpy registers a request after it has sent it, and drops a response that arrives before that. Here the processing
    of a response waits until the request is registered.
    """

    def __init__(self, *arguments, **options):
        self._sending = threading.RLock()
        super().__init__(*arguments, **options)

    def send_goal_async(self, *arguments, **options):
        """Send a goal; see rclpy."""
        with self._sending:
            return super().send_goal_async(*arguments, **options)

    def handle_of(self, goal_id: UUID) -> ClientGoalHandle:
        """The handle of a goal that the server works on, although its response never came.

        A server drops a response that it sends before it has discovered the client's reader.
        """
        return ClientGoalHandle(self, goal_id, self._action_type.Impl.SendGoalService.Response(accepted=True))

    def _cancel_goal_async(self, goal_handle):
        with self._sending:
            return super()._cancel_goal_async(goal_handle)

    def _get_result_async(self, goal_handle):
        with self._sending:
            return super()._get_result_async(goal_handle)

    async def execute(self, taken_data):
        """Process a response, after the request is registered."""
        with self._sending:
            pass
        await super().execute(taken_data)
