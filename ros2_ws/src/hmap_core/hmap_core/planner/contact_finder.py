"""Algorithm 3 in this process: proposed contacts first, sampled contacts next, each batch checked at once."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hmap_core.deadline import check_time
from hmap_core.exceptions import Code, ContactError
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.contact_checker import is_lifted
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.loads import weight_problem
from hmap_core.planner.protocols import ContactChecker, ContactProposer, ContactQuery, ContactSearchQuery
from hmap_core.planner.resampling import pose_steps
from hmap_core.planner.sampled_contacts import sampled_surface
from hmap_core.types import Scene, SceneState

STRETCH_WEIGHT = 0.7  # share of a contact's score that is lost when the arm is stretched out
SCORE_WEIGHT = 0.1  # poses of the path that one point of the sampler's score counts for
# of an object's path: a contact does not serve for so little, or leave so little, if another one goes farther
LITTLE, LITTLE_TURN = 0.03, float(np.deg2rad(17.0))  # m, rad
SWING_COST = 1.0  # poses of the path that a turn of a joint by 1 rad counts for, on the way to the contact


class ProposeAndCheck:
    """Implements :class:`hmap_core.planner.protocols.ContactFinder`.

    Robots are queried in the order of the query. The search stops once one contact covers the whole path; each robot
    is queried only for contacts that reach farther than those of the robots before. What a proposer has after an empty
    batch is checked only if no robot has a feasible contact without.

    Args:
        proposers: queried one after the other; sampled contacts come last.
        checker: checks what they propose.
    """

    def __init__(self, proposers: Sequence[ContactProposer], checker: ContactChecker):
        self.proposers, self.checker = tuple(proposers), checker

    def find_contacts(self, query: ContactSearchQuery) -> list[RobotContact]:
        """Return feasible contacts, the one with the highest score first.

        Raises:
            ContactError: NO_CONTACT; none is feasible.
        """
        deadline = time.monotonic() + query.time_limit
        rng = np.random.default_rng(query.seed)
        surface = sampled_surface(query.scene, query.state, query.object, query.object_poses[0], rng)
        found: list[RobotContact] = []
        searches: list[RobotSearch] = []
        robots = query.robots or tuple(query.scene.robots)
        for name in robots:
            beyond = max((contact.reach for contact in found), default=query.min_reach - 1)
            if beyond == len(query.object_poses) - 1:
                break
            own = ContactQuery(
                query.scene,
                query.state,
                query.object,
                query.object_poses,
                name,
                rng,
                query.cloud,
                surface,
                query.count,
                deadline,
            )
            searches.append(RobotSearch(self.proposers, self.checker, own))
            found += searches[-1].find(beyond)
        for search in searches:
            if found or not query.thorough:
                break
            found += search.find(query.min_reach - 1, to_the_end=True)
        ends_soon = _ends_soon(query.object_poses)
        waiting = list(searches)
        while found and waiting and all(ends_soon[contact.reach] for contact in found):
            farther = waiting[0].find(max(contact.reach for contact in found), to_the_end=True)
            found += farther
            waiting = waiting[not farther :]
        checked = sum(search.checked for search in searches)
        if not found:
            heavy = weight_problem(query.scene, query.object, robots, is_lifted(query.object_poses))
            what = f"none of {checked} contacts on '{query.object}' is reachable for {', '.join(robots)}"
            error = ContactError(what + (f": {heavy}" if heavy else ""), Code.NO_CONTACT)
            error.nothing_fits = query.thorough and all(search.nothing_fits for search in searches)
            raise error

        def cost(contact: RobotContact) -> tuple[bool, float]:
            return ends_soon[contact.reach], swing_cost(query.state, contact) - contact_score(query.scene, contact)

        return sorted(found, key=cost)[: query.count or None]


class RobotSearch:
    """The search for contacts of one robot, which can be left and gone on with.

    Args:
        proposers: queried one after the other.
        checker: checks what they propose.
        query: of the robot.

    Attributes:
        checked: how many contacts were checked.
        nothing_fits: the proposers ended after an empty batch, and had no contacts after it.
    """

    def __init__(self, proposers: Sequence[ContactProposer], checker: ContactChecker, query: ContactQuery):
        self._checker, self._query = checker, query
        self._batches = ((each, batch) for each in proposers for batch in each.propose(query))
        self.checked = 0
        self.nothing_fits = False

    def find(self, beyond: int = -1, to_the_end: bool = False) -> list[RobotContact]:
        """Check batches until one has feasible contacts, one is empty, or the time is up.

        Args:
            beyond: index of the pose farther than which the contacts have to reach.
            to_the_end: whether it goes on after an empty batch.
        """
        for proposer, batch in self._batches:
            self.nothing_fits = not batch
            if not (batch or to_the_end):
                break
            self.checked += len(batch)
            check_time()
            feasible = self._checker.check(self._query, batch.contacts, beyond)
            if feasible:
                source = getattr(proposer, "name", "")
                return [replace(contact, proposer=source, checked=self.checked) for contact in feasible]
            if time.monotonic() > self._query.deadline:
                break
        return []


def _ends_soon(object_poses: np.ndarray) -> np.ndarray:
    """Whether (M,) contacts that end at each of the poses (M, 7) serve for LITTLE of the path, or leave LITTLE of it.

    The object would be let go and touched again at once, so all contacts are looked at for one that goes farther.
    """
    steps = np.maximum(*pose_steps(object_poses, LITTLE, LITTLE_TURN))
    way = np.concatenate([[0.0], np.cumsum(steps)])
    soon = (way < 1.0) | (way > way[-1] - 1.0)
    soon[-1] = False
    return soon


def contact_score(scene: Scene, contact: RobotContact) -> float:
    """The score by which feasible contacts are ranked: how far they carry, less if the arm has to stretch."""
    robot = scene.robots[contact.robot]
    arm = load_arm(robot.model)
    frames = [arm.frames(q) for q in contact.keyframes[[0, -1]]]
    tips = [p[-1] + R[-1] @ arm.T_tip_ee[:3, 3] for R, p in frames]
    stretch = max(float(np.linalg.norm(tip - arm.p_joint[0])) for tip in tips) / arm.length
    return (contact.reach + SCORE_WEIGHT * contact.contact.score) * (1.0 - STRETCH_WEIGHT * stretch**2)


def swing_cost(state: SceneState, contact: RobotContact) -> float:
    """What the way of the arm to a contact costs, in poses of the object's path: by the joint that turns farthest."""
    return SWING_COST * float(np.abs(contact.keyframes[0] - state.q[contact.robot]).max())
