"""A plan, cut into subgoals between which all hands are free: what plan repair keeps or replaces as a whole."""

from dataclasses import dataclass, replace

from hmap_core.planner.planned_contacts import PlannedContact, planned_contacts
from hmap_core.types import Plan


@dataclass(frozen=True)
class PlannedSubgoal:
    """A part of a plan that begins and ends with free hands.

    Attributes:
        contacts: its contacts, one after the other; with a tool there are several.
    """

    contacts: tuple[PlannedContact, ...]

    @property
    def first(self) -> int:
        """The sample at which it begins."""
        return self.contacts[0].first

    @property
    def begin(self) -> int:
        """The sample at which its first contact is made."""
        return self.contacts[0].begin

    @property
    def last(self) -> int:
        """The sample at which the hand has retreated."""
        return self.contacts[-1].last

    @property
    def only_contact(self) -> PlannedContact | None:
        """Its contact, if there is only one."""
        return self.contacts[0] if len(self.contacts) == 1 else None

    @property
    def bodies(self) -> set[str]:
        """Names of the bodies that it moves."""
        return {contact.segment.object for contact in self.contacts if contact.segment.object is not None}


def planned_subgoals(plan: Plan) -> list[PlannedSubgoal]:
    """The subgoals of a plan in their order."""
    handled = dict.fromkeys(segment.object for segment in plan.segments if segment.object is not None)
    contacts = sorted((one for name in handled for one in planned_contacts(plan, name)), key=lambda one: one.begin)
    groups: list[list[PlannedContact]] = []
    for contact in contacts:
        if groups and contact.begin <= groups[-1][-1].last:
            groups[-1].append(contact)
        else:
            groups.append([contact])
    starts = [0, *(group[-1].last for group in groups)]
    return [
        PlannedSubgoal((replace(group[0], first=max(start, group[0].first)), *group[1:]))
        for start, group in zip(starts, groups, strict=False)
    ]
