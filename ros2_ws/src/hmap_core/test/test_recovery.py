"""When a new plan is asked for: after which failures, how often, and once bodies in the way have moved on."""

from types import SimpleNamespace

import numpy as np
import pytest

from hmap_core.exceptions import Code, ContactError, ExecutionError, HmapError, MotionError, PlannerError
from hmap_core.execution.failures import Blocked, Drifted
from hmap_core.execution.ports import Ports
from hmap_core.execution.recovery import Recovery, RecoveryPolicy
from hmap_core.planner.conflicts import Conflict
from hmap_core.scenes import load_scene
from hmap_core.types import Plan

AT = 1.0  # s of the old plan
POLICY = RecoveryPolicy(replans=2, obstacle_replans=1, obstacle_patience=10.0)


@pytest.fixture(scope="module")
def old() -> Plan:
    scene = load_scene("tunnel", 0)
    return Plan(scene, None, (), np.zeros((0, 7)), {})


def recovery(old, answers, moves=(), policy=POLICY, canceled=lambda: False):
    """A planner that does as ``answers`` say, bodies that move on as ``moves`` say, and what is asked."""
    asked, moves = [], list(moves)

    def replan(request):
        asked.append(request.blocked)
        answer = answers.pop(0)
        if isinstance(answer, HmapError):
            raise answer
        return answer

    observation = SimpleNamespace(
        scene=lambda: old.scene, changed=lambda: 0.0, wait_for_change=lambda *_: moves.pop(0) if moves else False
    )
    ports = Ports(None, observation, SimpleNamespace(now=lambda: 0.0))
    return Recovery(policy, replan, ports, canceled), asked


def blocked() -> Blocked:
    return Blocked(Conflict(2.0, "arm/hand", "ball"), AT)


def lost() -> ExecutionError:
    return ExecutionError("it slipped", Code.OBJECT_DROPPED)


def new_plan(recovery, old, failure):
    return recovery.new_plan(failure, old, old.scene.start_state)


def no_contact() -> ContactError:
    return ContactError("none", Code.NO_CONTACT)


def test_where_there_is_no_plan_the_bodies_have_to_move(old):
    decides, asked = recovery(old, [no_contact(), no_contact(), "plan"], [True, True])
    assert new_plan(decides, old, blocked()) == "plan"
    assert asked == [(old, AT)] * 3 and decides.error is None
    assert [bool(entry.failure) for entry in decides.replans] == [True, True, False]


def test_bodies_that_do_not_move_on_leave_the_error(old):
    decides, asked = recovery(old, [no_contact()], [False])
    assert new_plan(decides, old, blocked()) is None
    assert isinstance(decides.error, ContactError) and asked == [(old, AT)]


def test_a_cancel_is_the_answer_at_once(old):
    decides, asked = recovery(old, [PlannerError("canceled", Code.CANCELED)])
    with pytest.raises(PlannerError) as caught:
        new_plan(decides, old, blocked())
    assert caught.value.code is Code.CANCELED and asked == [(old, AT)]


def test_an_error_with_which_no_other_attempt_helps_is_the_answer_at_once(old):
    decides, asked = recovery(old, [PlannerError("gone", Code.SERVICE_UNAVAILABLE)])
    assert new_plan(decides, old, lost()) is None
    assert decides.error.code is Code.SERVICE_UNAVAILABLE and asked == [None]


def test_a_failure_is_planned_anew_as_often_as_allowed(old):
    decides, asked = recovery(old, [MotionError("no way"), "plan"])
    assert decides.accepts(lost(), {}, {}) and new_plan(decides, old, lost()) == "plan"
    assert asked == [None, None] and not decides.accepts(lost(), {}, {})


def test_a_body_in_the_way_counts_for_itself(old):
    decides, _ = recovery(old, ["plan"], policy=RecoveryPolicy(obstacle_replans=1))
    assert decides.accepts(blocked(), {}, {}) and not decides.accepts(lost(), {}, {})
    assert new_plan(decides, old, blocked()) == "plan"
    assert not decides.accepts(blocked(), {}, {})


@pytest.mark.parametrize("strict", [True, False])
def test_a_fall_ends_a_strict_execution_only(old, strict):
    decides, _ = recovery(old, [], policy=RecoveryPolicy(replans=1, strict=strict))
    missed = ExecutionError("off", Code.GOAL_MISSED)
    assert decides.accepts(lost(), {"box": 1.0}, {}) != strict
    assert decides.accepts(missed, {}, {"box": 0.03}) != strict
    assert decides.accepts(Drifted("off"), {}, {"box": 0.03})  # the report at the end says so


@pytest.mark.parametrize("code", [Code.SERVICE_UNAVAILABLE, Code.WAY_BLOCKED])
def test_other_failures_are_final(old, code):
    decides, _ = recovery(old, [])
    assert not decides.accepts(ExecutionError("no", code), {}, {})
