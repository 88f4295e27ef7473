"""Which bodies the contacts of a plan move, when, and with what."""

from dataclasses import dataclass

import numpy as np

from hmap_core.validation.contacts import Contact
from hmap_core.validation.world import Part, World


@dataclass(frozen=True)
class HeldBodies:
    """The bodies that contacts move: grasped, touched, pushed or pressed, by a hand or a tool, and the tool itself.

    Attributes:
        steps: mask (N-1,) of the steps in which a contact moves a body, by name.
        touching: pairs of owners that touch in these contacts: fingers or tool, and object.
    """

    steps: dict[str, np.ndarray]
    touching: frozenset[frozenset[str]]

    @classmethod
    def of(cls, world: World, contacts: list[Contact]) -> "HeldBodies":
        """The bodies that these contacts move."""
        steps: dict[str, np.ndarray] = {}
        for contact in contacts:
            mask = steps.setdefault(contact.object, np.zeros(world.samples - 1, bool))
            mask[contact.segment.first : contact.segment.last] = True
        return cls(steps, frozenset(frozenset((owner, c.object)) for c in contacts for owner in c.touching))

    def moves(self, part: Part) -> bool:
        """Whether a contact moves this part of a body at some time."""
        return part.link is None and part.holder in self.steps

    def concerns(self, a: Part, b: Part) -> bool:
        """Whether a contact moves one of two parts, and is not itself the contact between them."""
        return (self.moves(a) or self.moves(b)) and frozenset((a.owner, b.owner)) not in self.touching

    def in_step(self, part: Part, step: int) -> bool:
        """Whether a contact moves a part in a step."""
        return self.moves(part) and bool(self.steps[part.holder][step])


NOTHING_HELD = HeldBodies({}, frozenset())
