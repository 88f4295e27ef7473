"""Algorithm 1 with scripted components: what is tried after what, when it gives up, and what it then says."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from planner_fixtures import carry

from hmap_core.exceptions import Code, ContactError, HmapError, InputError, MotionError, PlannerError, WaypointError
from hmap_core.planner import J_MAX, HmapPlanner, PlannerComponents, PlanningJob, RobotContact, SubTrajectory, plan
from hmap_core.planner.assembly import assemble, state_after
from hmap_core.planner.outcome import Failure
from hmap_core.planner.protocols import SegmentQuery
from hmap_core.planner.search import ROUNDS
from hmap_core.planner.segments.contact_segment import CutCorner
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.planner.steps import MOST_CUT
from hmap_core.planner.strategies import PATH_STRATEGIES
from hmap_core.planner.strategies.manipulation_graph import ManipulationGraphStrategy
from hmap_core.planner.strategies.pressed_path import PressedPath
from hmap_core.planner.tasks import WaypointTask
from hmap_core.transforms import interpolate, pose
from hmap_core.types import ContactKind, ContactPoint, Goal, Segment, SegmentKind, Trajectory
from hmap_core.waypoints import NoObjectPath

PATH = 11  # poses of the object's path


@pytest.fixture(autouse=True)
def without_presses_and_intermediate_placements(monkeypatch):
    """Algorithm 1 alone: presses and the manipulation graph have tests of their own, and would call the script, too."""
    others = PressedPath, ManipulationGraphStrategy
    strategies = [strategy for strategy in PATH_STRATEGIES if not isinstance(strategy, others)]
    monkeypatch.setattr("hmap_core.planner.search.PATH_STRATEGIES", strategies)


class Script:
    """All components in one: contacts serve ``reach`` poses, and motions fail as long as ``fail(call number)``."""

    def __init__(self, reach=4, contacts=3, fail=lambda k: False, no_contact=False, works=lambda: None):
        self.reach, self.contacts, self.fail, self.no_contact, self.works = reach, contacts, fail, no_contact, works
        self.hands: list[ContactPoint] = []  # that are good at both ends
        self.calls: list[str] = []
        self.poses: list[np.ndarray] = []
        self.seeds: list[int] = []
        self.thorough: list[bool] = []

    error, nothing_fits = MotionError, False
    tool_grasps = plan_pick = plan_place = propose = promising = None  # there are no tools

    @property
    def planner(self):
        return HmapPlanner(PlannerComponents(self, self, self, self, self, self, self))

    def plan_path(self, query):
        self.calls.append("waypoints")
        self.seeds.append(query.seed)
        poses = interpolate(query.state.poses[query.goal.object], query.goal.pose, np.linspace(0, 1, PATH))
        return SimpleNamespace(poses=poses)

    def find_contacts(self, query):
        assert query.object in query.scene.bodies
        self.calls.append("contacts")
        self.poses.append(query.object_poses)
        self.thorough.append(query.thorough)
        if self.no_contact:
            error = ContactError("nothing is reachable", Code.NO_CONTACT)
            error.nothing_fits = self.nothing_fits
            raise error
        self.works()
        contact = ContactPoint(ContactKind.GRASP, pose(), np.zeros(3), np.zeros(3), 0.05, np.array([0, 0, 1.0]))
        reach = min(self.reach, len(query.object_poses) - 1)
        return [RobotContact("arm", contact, reach, np.zeros((reach + 1, 7)))] * min(self.contacts, query.count)

    def find(self, scene, state, object, T_goal, robot, count, seed, to_the_end=True):
        return self.hands

    def check(self, query, contacts, beyond=-1):
        self.calls.append("hand")
        reach = len(query.object_poses) - 1
        return [RobotContact(query.robot, contact, reach, np.zeros((reach + 1, 7))) for contact in contacts]

    def plan_segment(self, query):
        self.calls.append("motion")
        if self.fail(self.calls.count("motion")):
            raise self.error(f"try {self.calls.count('motion')} fails")
        count = len(query.object_poses)
        joints = {"arm": np.repeat(query.state.q["arm"][None], count, 0)}
        trajectory = Trajectory(
            0.02 * np.arange(count), joints, {"arm": np.full(count, 0.08)}, {query.object: query.object_poses}
        )
        segment = Segment(0.0, 0.02 * (count - 1), "arm", "panda_hand", query.object, SegmentKind.GRASP, pose())
        return SubTrajectory(trajectory, (segment,))


@pytest.fixture
def scene(tmp_path):
    return carry(tmp_path)


def failure(script, scene, **limits) -> HmapError:
    with pytest.raises(HmapError) as error:
        script.planner.plan(scene, **limits)
    assert error.value.stage and error.value.reason
    return error.value


def test_a_plan_that_nobody_could_execute_is_rejected_and_planned_anew(scene):
    """The object flies by itself here: the judge has the last word, and the violation is named."""
    script = Script()
    error = failure(script, scene)
    assert (error.stage, error.code) == ("planner", Code.PLAN_REJECTED)
    assert "brick" in error.reason
    assert script.calls.count("waypoints") == ROUNDS
    assert len(set(script.seeds)) == ROUNDS


def test_the_main_loop_goes_on_where_the_last_contact_ended(scene):
    script = Script(reach=4, fail=lambda k: k > 3)
    failure(script, scene)
    assert script.calls[:7] == ["waypoints", "contacts", "motion", "contacts", "motion", "contacts", "motion"]
    first, second, third = script.poses[:3]
    assert (len(first), len(second), len(third)) == (11, 7, 3)
    np.testing.assert_allclose(second[0], first[4])
    np.testing.assert_allclose(third[0], first[8])


def test_the_inner_loop_tries_the_next_contact_and_stops_at_j_max(scene):
    script = Script(contacts=7, fail=lambda k: True)
    error = failure(script, scene)
    assert error.code == Code.NO_MOTION and f"try {ROUNDS * J_MAX} fails" in error.reason
    assert script.calls.count("motion") == ROUNDS * J_MAX


@pytest.mark.parametrize("of_object", [True, False])
def test_a_path_on_which_the_object_itself_hits_something_is_left_early(scene, of_object):
    """Other contacts carry the object along the same path; only what the hand hits changes with the contact."""

    def error(reason):
        cut = CutCorner(reason)
        cut.of_object = of_object
        return cut

    script = Script(contacts=7, fail=lambda k: True)
    script.error = error
    assert failure(script, scene).code == Code.NO_MOTION
    assert script.calls.count("motion") == (MOST_CUT if of_object else ROUNDS * J_MAX)


def test_where_no_hand_follows_the_path_one_is_sought_for_a_hand(scene):
    script = Script(contacts=1, fail=lambda k: k <= J_MAX)
    contact = ContactPoint(ContactKind.GRASP, pose((0, 0, 0.1)), np.zeros(3), np.zeros(3), 0.05, np.array([0, 0, 1.0]))
    script.hands = [contact]
    seen = []
    failure(script, scene, progress=seen.append)
    assert script.calls[: 2 + 2 * J_MAX] == ["waypoints", *["contacts", "motion"] * J_MAX, "waypoints"]
    assert script.calls[2 + 2 * J_MAX : 4 + 2 * J_MAX] == ["hand", "motion"]
    assert any("with a hand attached" in p.text for p in seen)


def test_without_contacts_the_reach_of_the_goal_is_asked(scene):
    error = failure(Script(no_contact=True), scene)
    assert (error.stage, error.code) == ("contacts", Code.OUT_OF_REACH)
    assert "brick" in error.reason and "arm" in error.reason


@pytest.mark.parametrize("nothing_fits", [True, False])
def test_that_no_hand_fits_on_an_object_is_found_out_once(scene, nothing_fits):
    script = Script(no_contact=True)
    script.nothing_fits = nothing_fits
    job = PlanningJob(script.planner, scene)
    poses = interpolate(job.start.poses["brick"], scene.goal.pose, np.linspace(0, 1, PATH))
    task = WaypointTask.of(job.context, Subgoal(scene.goal), SolutionSequence(job.start), poses, 0, None)
    assert isinstance(job.search.try_contacts(task, samplings=3), Failure)
    assert script.thorough == [True, not nothing_fits, not nothing_fits]


def test_the_same_holds_for_a_removable_body(scene):
    job = PlanningJob(Script(no_contact=True).planner, replace(scene, removable={"brick": None}))
    with pytest.raises(ContactError) as error:
        job.search.bring(Subgoal(scene.goal), SolutionSequence(job.start))
    assert error.value.code == Code.OUT_OF_REACH


def test_an_object_without_a_path_is_reported_as_it_is(scene):
    script = Script()

    def blocked(*args):
        raise WaypointError("no path of 'brick'")

    script.plan_path = blocked
    assert failure(script, scene).code == Code.NO_OBJECT_PATH


@pytest.mark.parametrize("contacts_fail", [True, False])
def test_a_later_search_without_a_path_ends_nothing(scene, contacts_fail):
    """Neither among the first paths, none of which leads to a contact, nor after those."""
    script = Script(no_contact=contacts_fail, fail=lambda k: True)
    search = script.plan_path

    def only_once(*args):
        if "waypoints" in script.calls:
            script.calls.append("none")
            raise NoObjectPath("no path of 'brick'", ("wall",), None)
        return search(*args)

    script.plan_path = only_once
    error = failure(script, scene)
    assert script.calls.count("none") == (1 if contacts_fail else ROUNDS - 1)
    assert error.code == (Code.OUT_OF_REACH if contacts_fail else Code.NO_MOTION)


def test_the_time_limit_is_honoured_with_the_last_failure_as_reason(scene):
    error = failure(Script(fail=lambda k: True, works=lambda: time.sleep(0.03)), scene, time_limit=0.1)
    assert isinstance(error, PlannerError) and error.code == Code.TIME_LIMIT
    assert "0.1 s" in error.reason and "fails" in error.reason
    assert failure(Script(), scene, time_limit=0.0).code == Code.TIME_LIMIT


def test_cancel_is_honoured_between_two_steps(scene):
    for after in (0, 1, 3):
        script = Script(fail=lambda k: True)
        error = failure(script, scene, cancel=lambda s=script, n=after: len(s.calls) > n)
        assert error.code == Code.CANCELED
        assert len(script.calls) <= after + 2


def test_progress_tells_what_is_being_done(scene):
    seen = []
    failure(Script(), scene, progress=seen.append)
    assert [p.phase for p in seen[:4]] == ["waypoints", "contacts", "motion", "contacts"]
    assert "checking" in [p.phase for p in seen]
    assert (seen[3].waypoint, seen[3].waypoints) == (4, PATH - 1)
    assert all(p.text for p in seen)


@pytest.mark.parametrize("name", ["nothing", "wall"])
def test_a_goal_for_what_cannot_be_moved_is_refused(scene, name):
    with pytest.raises(InputError, match=f"'{name}'.*allowed: brick") as error:
        plan(scene.with_goal(Goal(name, pose((0.5, 0, 0.1)))))
    assert error.value.code == Code.UNKNOWN_OBJECT


def test_a_robot_that_starts_beyond_its_limits_or_in_the_table_is_refused(scene):
    state = scene.start_state()
    state.q["arm"][3] = 0.5
    with pytest.raises(InputError, match="panda_joint4 at 0.5000; allowed: -3.0718 to -0.0698"):
        plan(scene, state)
    state.q["arm"] = np.array([0.0, 1.5, 0.0, -0.6, 0.0, 2.0, 0.8])
    with pytest.raises(InputError, match="arm.*inside.*overlap") as error:
        plan(scene, state)
    assert error.value.code == Code.START_IN_COLLISION


def test_segments_are_put_together_without_gaps(scene):
    state, script = scene.start_state(), Script()
    poses = interpolate(state.poses["brick"], scene.goal.pose, np.linspace(0, 1, 9))
    first = script.plan_segment(SegmentQuery(scene, state, "brick", None, poses[:5]))
    after = state_after(state, first)
    np.testing.assert_array_equal(after.poses["brick"], poses[4])
    np.testing.assert_array_equal(state.poses["brick"], poses[0])
    second = script.plan_segment(SegmentQuery(scene, after, "brick", None, poses[4:]))
    made = assemble(scene, state, [first, second], poses[[4, 8]], {})
    np.testing.assert_allclose(made.trajectory.time, 0.02 * np.arange(9))
    np.testing.assert_array_equal(made.trajectory.objects["brick"], poses)
    assert [(s.start, s.end) for s in made.segments] == [
        (0.0, pytest.approx(0.08)),
        (pytest.approx(0.08), pytest.approx(0.16)),
    ]
