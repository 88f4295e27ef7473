"""What is wrong is named once per cause, not once per message."""

import pytest

from hmap.problem_log import ACTIVE_FOR, FORGET_AFTER, SOURCES_KEPT, ProblemLog, cause_of

NAN = "the velocity of joint 'panda_joint1' is nan; it must be finite"


class Log:
    """A problem log with what it wrote, and a clock that a test sets."""

    def __init__(self):
        self.warned, self.informed, self.now = [], [], 0.0
        self.problems = ProblemLog(self.warned.append, self.informed.append, lambda: self.now)


@pytest.fixture
def log():
    return Log()


def test_same_cause_in_every_message_is_named_once(log):
    for i in range(100):
        log.problems.update("poses", [f"the pose is stamped {3600.0 - 0.1 * i:.2f} s ahead of the clock"])
    assert log.warned == ["poses: the pose is stamped 3600.00 s ahead of the clock"]


def test_each_cause_is_named_also_several_in_one_message(log):
    log.problems.update("joints", [NAN, NAN.replace("joint1", "joint2")])
    log.problems.update("joints", [NAN, "9 names and 7 velocities"])
    assert len(log.warned) == 3


def test_what_heals_and_comes_back_is_named_again(log):
    for _ in range(2):
        log.problems.update("joints", [NAN])
        log.problems.update("joints", [])
        log.problems.update("joints", [])
    assert len(log.warned) == 2 and "2. time" in log.warned[1]
    assert log.informed == [f"joints: no longer so: {NAN}"] * 2


def test_what_comes_and_goes_is_named_ever_more_rarely(log):
    for _ in range(1000):
        log.problems.update("joints", [NAN])
        log.problems.update("joints", [])
    assert len(log.warned) == 10  # 1, 2, 4 ... 512
    log.now += 2.0 * FORGET_AFTER
    log.problems.update("joints", [])
    log.problems.update("joints", [NAN])
    assert len(log.warned) == 11


def test_sources_do_not_heal_each_other(log):
    for _ in range(10):
        log.problems.update(("joint_states", "a"), [NAN], "joint_states")
        log.problems.update(("joint_states", "b"), [], "joint_states")
    assert log.warned == [f"joint_states: {NAN}"] and not log.informed


def test_active_problems_are_those_of_now(log):
    log.problems.update("joints", [NAN])
    assert log.problems.active() == [f"joints: {NAN}"]
    log.now = 2.0 * ACTIVE_FOR
    assert not log.problems.active()
    log.problems.update("joints", [NAN])
    log.problems.update("joints", [])
    assert not log.problems.active()


def test_names_that_change_forever_do_not_fill_the_memory(log):
    for i in range(2 * SOURCES_KEPT):
        log.problems.update(i, [NAN])
    assert len(log.problems._sources) <= SOURCES_KEPT and len(log.problems._labels) <= SOURCES_KEPT


def test_numbers_are_no_part_of_a_cause_but_names_are():
    assert cause_of("is -3.5e-7 m at index 12") == cause_of("is nan m at index 3")
    assert cause_of("joint 'arm_1'") != cause_of("joint 'arm_2'")
