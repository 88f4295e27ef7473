"""The grippers of an execution: in which order they close and open when an object changes hands."""

from types import SimpleNamespace

import numpy as np
import pytest

from hmap_core.exceptions import Code, ExecutionError
from hmap_core.execution.hands import Hands
from hmap_core.execution.stretches import Stretch
from hmap_core.types import Gripper

FORCE, WIDTH, OPEN = 40.0, 0.04, 0.08  # N, m, m
GRIPPER = Gripper(("finger",), 1.0, ("pad",), 0.0, 0.078, OPEN, 0.0, 0.01, FORCE)
ROBOTS = {
    name: SimpleNamespace(name=name, model=SimpleNamespace(gripper=GRIPPER, require_gripper=lambda: GRIPPER))
    for name in ("giver", "taker")
}


class Controllers:
    """Notes commands to grippers and when they are waited for; closing ends at ``reached`` (m)."""

    def __init__(self, reached: float = WIDTH):
        self.told: list[str] = []
        self._reached = reached

    def grip(self, robot, opening: float, force: float):
        self.told.append(f"{robot.name} {'closes' if opening < WIDTH else 'opens'}")
        return SimpleNamespace(done=True, opening=max(opening, self._reached))

    def wait(self, commands, limit, canceled, look=None) -> None:
        self.told += ["wait"] if commands else []


def plan(openings: dict[str, float]):
    trajectory = SimpleNamespace(
        time=np.arange(2.0), gripper={name: np.full(2, opening) for name, opening in openings.items()}
    )
    return SimpleNamespace(scene=SimpleNamespace(robots=ROBOTS), trajectory=trajectory)


def stretch(**held: str) -> Stretch:
    return Stretch(0, 1, held, "", tuple(held.values()), False, False)


def hands(controllers: Controllers) -> Hands:
    observation = SimpleNamespace(grasped=lambda robot, body: None)
    return Hands(SimpleNamespace(controllers=controllers, observation=observation), lambda: False)


def test_what_is_passed_on_is_let_go_once_the_other_gripper_holds_it():
    controllers = Controllers()
    own = hands(controllers)
    own.grip(plan({"giver": WIDTH, "taker": OPEN}), stretch(giver="bar"), lambda: None)
    controllers.told.clear()
    own.grip(plan({"giver": OPEN, "taker": WIDTH}), stretch(taker="bar"), lambda: None)
    assert controllers.told == ["taker closes", "wait", "giver opens", "wait"]
    assert own.held == {"taker": "bar"}


def test_a_gripper_that_closes_on_nothing_leaves_the_object_to_the_other_one():
    controllers = Controllers()
    own = hands(controllers)
    own.grip(plan({"giver": WIDTH, "taker": OPEN}), stretch(giver="bar"), lambda: None)
    controllers.told.clear()
    controllers._reached = 0.0
    with pytest.raises(ExecutionError) as error:
        own.grip(plan({"giver": OPEN, "taker": WIDTH}), stretch(taker="bar"), lambda: None)
    assert error.value.code is Code.OBJECT_DROPPED and "taker" in error.value.reason
    assert controllers.told == ["taker closes", "wait"] and own.held == {"giver": "bar"}


def test_both_grippers_hold_one_object():
    own = hands(Controllers())
    own.grip(plan({"giver": WIDTH, "taker": OPEN}), stretch(giver="bar"), lambda: None)
    own.grip(plan({"giver": WIDTH, "taker": WIDTH}), stretch(giver="bar", taker="bar"), lambda: None)
    assert own.held == {"giver": "bar", "taker": "bar"}
