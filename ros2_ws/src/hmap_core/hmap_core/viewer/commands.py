"""What the page can ask of a graph of nodes; the page itself knows no ROS."""

from typing import Protocol

PAUSE, RESUME, STOP, CONFIRM, SPEED = "pause", "resume", "stop", "confirm", "speed"


class Commands(Protocol):
    """Buttons of the page. A method raises :class:`hmap_core.exceptions.HmapError` where it cannot do so."""

    def tasks(self) -> list[str]:
        """Names of the tasks that can be chosen."""
        ...

    def available(self) -> set[str]:
        """Those of PAUSE, RESUME, STOP, CONFIRM and SPEED that somebody listens to now."""
        ...

    def start(self, task: str, seed: int, plan_only: bool) -> None:
        """Plan a task, and execute the plan unless ``plan_only``. Returns at once."""
        ...

    def replan(self) -> None:
        """End the goal, and plan and execute anew from where everything is. Returns at once."""
        ...

    def cancel(self) -> None:
        """Ask for the end of the goal. Returns at once."""
        ...

    def call(self, name: str) -> str:
        """PAUSE, RESUME, STOP or CONFIRM; the answer, for people."""
        ...

    def set_speed(self, share: float) -> None:
        """Set the speed of motions, above 0, up to 1."""
        ...
