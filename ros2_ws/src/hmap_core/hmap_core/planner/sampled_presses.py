"""Presses sampled on the top of an object that slides: fingertips drag it by friction."""

from collections.abc import Iterator

import numpy as np

from hmap_core.contacts.candidates import Situation
from hmap_core.contacts.press import Press, SlidingSupport
from hmap_core.planner.contact_finder import ProposeAndCheck
from hmap_core.planner.protocols import ContactChecker, ContactProposals, ContactProposer, ContactQuery
from hmap_core.planner.sampled_contacts import sampled_surface
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.types import Scene, SceneState

BATCH = 40  # presses in a batch
MAX_PRESSES = 120  # proposed for one robot


class SampledPresses:
    """Implements :class:`hmap_core.planner.protocols.ContactProposer`.

    Those that reach farthest come first, and then those with the highest score.
    """

    def propose(self, query: ContactQuery) -> Iterator[ContactProposals]:
        """Yield batches of at most BATCH presses, each with its force; none where friction or height exclude them."""
        scene, poses = query.scene, query.object_poses
        press = press_of(scene, query.state, query.object, query.robot, poses)
        if len(poses) < 2 or not press.possible:
            return
        surface = query.surface
        if surface is None:
            surface = sampled_surface(scene, query.state, query.object, poses[0], query.rng)
        situation = Situation(poses[0], poses[1], scene.robots[query.robot].base_pose[:3])
        made = press.with_forces(press.sampled(surface, situation, query.rng), poses)
        made.sort(key=lambda own: (-own[1], -own[0].score))
        for first in range(0, min(len(made), MAX_PRESSES), BATCH):
            yield ContactProposals(tuple(contact for contact, _ in made[first : first + BATCH]))


def press_finder(checker: ContactChecker, *others: ContactProposer) -> ProposeAndCheck:
    """A finder of presses, and of other contacts where there are none."""
    return ProposeAndCheck([SampledPresses(), *others], checker)


def press_of(scene: Scene, state: SceneState, object: str, robot: str, poses: np.ndarray) -> Press:
    """The presses of a robot on an object that slides along poses (M, 7)."""
    body = scene.bodies[object]
    support = SlidingSupport.of(body, poses, placed_bodies(scene, state, object))
    return Press(body, scene.robots[robot].model, support, poses[0])
