"""What is computed only where somebody asks for it: search trees of the object, and contacts that were refused."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hmap_core.contacts.feasibility import carried, reach_bounds, reachable
from hmap_core.exceptions import PlannerError
from hmap_core.planner.contact_checker import LocalContactChecker, cleared
from hmap_core.planner.object_path import object_path_problem
from hmap_core.planner.protocols import ContactProposals, ContactQuery, ObjectPathQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.trajectory.samples import index_at, state_at
from hmap_core.transforms import apply, multiply, pose
from hmap_core.types import ContactPoint, Plan, Segment, SegmentKind
from hmap_core.waypoints.checker import Geometry, body_middle, recentred
from hmap_core.waypoints.roadmap import exits
from hmap_core.waypoints.rrt import ROUNDS, grow_trees
from hmap_core.waypoints.search import MotionSpace
from hmap_core.waypoints.search_budget import SearchBudget

TIME_LIMIT = 10.0  # s
MOST_CONTACTS = 40  # that are checked at one contact of a plan
MOST_POSES = 24  # of the object that a contact has to follow
PLANNED = 0.005  # m from a contact of the plan; the same contact is not refused


@dataclass(frozen=True)
class Trees:
    """Search trees of an object.

    Attributes:
        edges: (E, 2, 3) between positions of the object, world frame, m.
        text: what was found, for people.
    """

    edges: np.ndarray
    text: str


def object_trees(plan: Plan) -> Trees:
    """RRT-Connect trees between start and goal of a plan's object, grown with the seed of its scene.

    Raises:
        PlannerError: no search applies.
        InputError: start or goal is in collision.
    """
    scene = plan.scene
    query = ObjectPathQuery(scene, scene.start_state(), scene.goal, scene.seed, TIME_LIMIT)
    problem = object_path_problem(query)
    middle = body_middle(problem.body)
    central = recentred(problem, middle)
    budget, rng = SearchBudget(TIME_LIMIT), np.random.default_rng(scene.seed)
    kinds = {"planar": (True,), "spatial": (False,)}.get(scene.motion, (True, False))
    for planar in kinds:
        space = MotionSpace(central, planar)
        if not space.prepare(Geometry(central), planar is kinds[-1]):
            continue
        start, goal = space.ends
        if planar and len(kinds) > 1 and np.abs(goal - central.goal).max() > 1e-6:
            continue  # planar motion does not end at the goal
        checker = space.checkers[0]
        starts = [start, *exits(checker, start, goal, space.bounds)]  # free of narrow places, as in the search
        goals = [goal, *exits(checker, goal, start, space.bounds)]
        for fraction, motions in ROUNDS:
            grown = grow_trees(checker, starts, goals, space.bounds, rng, fraction, motions, budget)
            if grown.path() is not None:
                break
        back = pose(-middle)
        edges = [
            [multiply(grown.nodes[side, k], back)[:3], multiply(grown.nodes[side, max(above, 0)], back)[:3]]
            for side in (0, 1)
            for k, above in enumerate(grown.parent[side, : grown.count[side]].tolist())
        ]
        met = "met" if grown.path() is not None else "did not meet"
        motion = "planar" if planar else "spatial"
        nodes = f"{int(grown.count[0])} and {int(grown.count[1])} poses"
        return Trees(np.array(edges).reshape(-1, 2, 3), f"RRT-Connect, {motion} motion: trees of {nodes}, which {met}")
    raise PlannerError("no motion type applies to the object of this plan")


def refused_contacts(plan: Plan) -> list[tuple[np.ndarray, str]]:
    """Contacts that cannot do what the contacts of a plan do: where (3,), world frame, and why not."""
    found: list[tuple[np.ndarray, str]] = []
    for segment in plan.segments:
        by_hand = segment.manipulator not in plan.scene.bodies
        if segment.kind is not SegmentKind.TRANSIT and segment.object is not None and by_hand:
            found += _refused(plan, segment)
    return found


def _refused(plan: Plan, segment: Segment) -> Iterator[tuple[np.ndarray, str]]:
    """The refused contacts at one contact of a plan."""
    time, name = plan.trajectory.time, segment.contact_object
    first, last = index_at(time, segment.start), index_at(time, segment.end)
    samples = np.unique(np.linspace(first, last, min(MOST_POSES, last - first + 1)).round().astype(int))
    poses = plan.trajectory.objects[name][samples]
    state = state_at(plan, first)
    rng = np.random.default_rng(plan.scene.seed)
    query = ContactQuery(plan.scene, state, name, poses, segment.robot, rng)
    batch = next(SampledContacts().propose(query), ContactProposals(()))
    contacts = list(batch.contacts)[:MOST_CONTACTS]
    chosen = segment.T_obj_manipulator[:3]
    contacts = [contact for contact in contacts if np.linalg.norm(contact.T_obj_ee[:3] - chosen) > PLANNED]
    for contact, reason in zip(contacts, _reasons(query, contacts), strict=True):
        if reason:
            kind = f"{segment.robot}: {contact.kind} of '{name}' at {segment.start:.1f} s"
            yield apply(poses[0], contact.point), f"{kind} is refused: {reason}"


def _reasons(query: ContactQuery, contacts: list[ContactPoint]) -> list[str]:
    """Why each contact is refused; empty where it is not."""
    if not contacts:
        return []
    checker = LocalContactChecker()
    manipulation, _ = cleared(query.scene, query.state, query.object, query.robot)
    end = len(query.object_poses) - 1
    bounds = reach_bounds(manipulation, contacts, query.object_poses)
    hands = {id(contact) for contact in checker.promising(query, contacts)}
    ok, q = reachable(manipulation, contacts, query.object_poses[0], query.rng)
    release = checker.release(query.scene, query.state, query.object, query.object_poses)
    reasons = []
    for k, contact in enumerate(contacts):
        if bounds[k] < 0:
            reasons.append("the hand collides there, or the arm is too short")
        elif not ok[k]:
            reasons.append("the arm has no configuration without collision in which the hand is there")
        elif id(contact) not in hands:
            far = f"the hand can follow to {bounds[k]} of {end} poses of the object"
            reasons.append(far if bounds[k] < end else "it would slip under the object's weight")
        else:
            reach = len(carried(manipulation, contact, q[k], query.object_poses, release)) - 1
            reasons.append(
                "" if reach == end else f"the arm can follow to {max(reach, 0)} of {end} poses of the object"
            )
    return reasons
