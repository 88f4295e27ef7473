"""rclpy's action client, safe to be used from another thread than the executor's."""

import threading

from rclpy.action import ActionClient as RclpyActionClient


class ActionClient(RclpyActionClient):
    """rclpy's client notes a question after it has sent it, and drops an answer that comes before the note is made.

    Here an answer waits until whoever is asking has made the note.
    """

    def __init__(self, *arguments, **options):
        self._asking = threading.RLock()
        super().__init__(*arguments, **options)

    def send_goal_async(self, *arguments, **options):
        with self._asking:
            return super().send_goal_async(*arguments, **options)

    def _cancel_goal_async(self, goal_handle):
        with self._asking:
            return super()._cancel_goal_async(goal_handle)

    def _get_result_async(self, goal_handle):
        with self._asking:
            return super()._get_result_async(goal_handle)

    async def execute(self, taken_data):
        with self._asking:
            pass
        await super().execute(taken_data)
