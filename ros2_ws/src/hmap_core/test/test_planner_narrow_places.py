"""Objects in narrow places: contacts that the hand alone can make, pick and place by the arm, what hides what."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core.contacts.feasibility import reach_bounds
from hmap_core.exceptions import ContactError
from hmap_core.planner import HmapPlanner, PlanningJob
from hmap_core.planner.contact_checker import cleared
from hmap_core.planner.contact_finder import ProposeAndCheck
from hmap_core.planner.obstacle_removal import ObstacleRemoval
from hmap_core.planner.outcome import Solution
from hmap_core.planner.protocols import ContactProposals, ContactQuery, ContactSearchQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.planner.strategies.attached_path import AttachedPathStrategy
from hmap_core.planner.strategies.pick_and_place import PickAndPlace
from hmap_core.scenes import load_robot_model
from hmap_core.transforms import pose
from hmap_core.types import BodyKind, Goal, SegmentKind

DEEP = (0.55, 0.0, 0.025)  # m, the cube under the bridge
AWAY = (0.3, 0.4, 0.025)


def bridge(*more, goal=AWAY):
    """A cube 100 mm deep under a bridge 260 mm wide and 150 mm high."""
    roof = box("roof", (0.3, 0.3, 0.02), (0.6, 0.0, 0.16), BodyKind.FIXED)
    walls = [box(f"wall{s}", (0.3, 0.02, 0.15), (0.6, s * 0.14, 0.075), BodyKind.FIXED) for s in (-1, 1)]
    cube, model = box("cube", (0.05, 0.05, 0.05), DEEP), load_robot_model("fr3")
    made = scene(cube, roof, *walls, *more, goal=Goal("cube", pose(goal), 0.005, 3.14))
    return replace(made, robots={"left": replace(made.robots["left"], model=model, q=model.home.copy())})


def query(made, seed: int = 0) -> ContactQuery:
    state = made.start_state()
    return ContactQuery(made, state, "cube", state.poses["cube"][None], "left", np.random.default_rng(seed))


def fitting(made, contacts) -> np.ndarray:
    state = made.start_state()
    manipulation, _ = cleared(made, state, "cube", "left")
    return reach_bounds(manipulation, contacts, state.poses["cube"][None]) >= 0


def test_contacts_that_the_hand_can_make_in_a_narrow_place_are_proposed_last():
    made = bridge()
    *ordinary, pause, costly = (batch.contacts for batch in SampledContacts().propose(query(made)))
    assert sum(fitting(made, batch).sum() for batch in ordinary) < 40
    assert not pause and len(costly) > 40
    assert fitting(made, costly).all()


def test_robots_are_asked_for_ordinary_contacts_before_any_is_asked_for_costly_ones():
    made, asked = bridge(), []

    class Proposer:
        def propose(self, query):
            for costly in (False, True):
                asked.append((query.robot, costly))
                yield ContactProposals(next(iter(SampledContacts().propose(query))).contacts[:1])
                if not costly:
                    yield ContactProposals(())

    class Checker:
        def check(self, query, contacts, beyond=-1):
            return []

    made = replace(made, robots=made.robots | {"other": made.robots["left"]})
    cube = made.bodies["cube"].pose
    search = ContactSearchQuery(made, made.start_state(), "cube", cube[None], robots=("left", "other"))
    with pytest.raises(ContactError):
        ProposeAndCheck([Proposer()], Checker()).find_contacts(search)
    assert asked == [("left", False), ("other", False), ("left", True), ("other", True)]


def test_the_same_seed_proposes_the_same_contacts():
    first, second = (
        [contact.T_obj_ee for batch in SampledContacts().propose(query(bridge(), 3)) for contact in batch.contacts]
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


def test_an_arm_that_cannot_follow_a_path_of_the_object_picks_and_places(monkeypatch):
    ends_only = AttachedPathStrategy()
    monkeypatch.setattr(ends_only, "_paths", _without_paths(ends_only._paths), raising=False)
    monkeypatch.setattr("hmap_core.planner.search.PATH_STRATEGIES", (ends_only, PickAndPlace()))
    plan = PlanningJob(HmapPlanner(), bridge(), seed=0, time_limit=300.0).plan()
    kinds = [segment.kind for segment in plan.segments if segment.object == "cube"]
    assert kinds and set(kinds) == {SegmentKind.GRASP}
    np.testing.assert_allclose(plan.trajectory.objects["cube"][-1][:3], AWAY, atol=0.005)


def _without_paths(find):
    """Contacts at both ends are found, but no path between them."""

    def paths(*args):
        list(find(*args))
        return iter(())

    return paths


class Placing:
    """A search that brings every body where it is wanted, and notes the order."""

    def __init__(self, context):
        self.context, self.order = context, []

    def bring(self, subgoal, sequence):
        self.order.append(subgoal.goal.object)
        state = sequence.state.copy()
        state.poses[subgoal.goal.object] = subgoal.goal.pose
        return Solution(replace(sequence, state=state))


@pytest.fixture(scope="module")
def hidden():
    """Behind the cube under the bridge stands another one, which no hand reaches."""
    made = bridge(box("behind", (0.05, 0.05, 0.05), (0.66, 0.0, 0.025)), box("goal", (0.05,) * 3, (0.3, -0.4, 0.025)))
    return replace(made, removable={"behind": None, "cube": None}, goal=Goal("goal", pose((0.4, -0.3, 0.025))))


def test_a_body_on_which_a_hand_fits_goes_before_one_that_it_hides(hidden):
    search = Placing(PlanningJob(HmapPlanner(), hidden).context)
    removal = ObstacleRemoval(search)
    removal.clear(Subgoal(hidden.goal), SolutionSequence(hidden.start_state()), ["behind", "cube"], ())
    assert search.order == ["cube", "behind"]


def test_a_hidden_body_is_not_tried_alone(hidden):
    search = Placing(PlanningJob(HmapPlanner(), hidden).context)
    subgoals = []
    search.bring, bring = (lambda subgoal, sequence: subgoals.append(subgoal) or bring(subgoal, sequence)), search.bring
    ObstacleRemoval(search).clear(Subgoal(hidden.goal), SolutionSequence(hidden.start_state()), ["behind"], ())
    assert [(subgoal.goal.object, subgoal.alone) for subgoal in subgoals] == [("behind", False)]
