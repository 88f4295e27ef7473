"""Propose contacts, as a network would: here, a grasp from above. Proposals are checked; sampling is the fallback."""

from collections.abc import Iterator

import numpy as np

from hmap_core import planner
from hmap_core.planner import ContactProposals, ContactQuery, plugins
from hmap_core.scenes import SceneBuilder
from hmap_core.transforms import pose
from hmap_core.types import ContactKind, ContactPoint, ShapeKind


class FromAbove:
    """Implements :class:`hmap_core.planner.ContactProposer` for boxes."""

    def propose(self, query: ContactQuery) -> Iterator[ContactProposals]:
        """Yield one batch: fingers on the two faces across y, the hand pointing down.

        A network would look at ``query.cloud`` (points and normals in the object's frame), draw with ``query.rng``, and
        say how sure it is of each contact.
        """
        shape = query.scene.bodies[query.object].shapes[0]
        if query.tool is not None or shape.kind is not ShapeKind.BOX:
            return
        width, height = shape.size[1], shape.size[2]
        contact = ContactPoint(
            ContactKind.GRASP,
            T_obj_ee=pose((0, 0, 0.25 * height), (1, 0, 0, 0)),  # the approach, z, points down; fingers close along y
            point=np.array([0.0, width / 2, 0.25 * height]),
            normal=np.array([0.0, 1.0, 0.0]),
            opening=width,
            approach=np.array([0.0, 0.0, 1.0]),
        )
        yield ContactProposals((contact,), confidence=(0.9,))


# A package registers it for `hmap plan TASK --proposer from_above` by an entry point in its pyproject.toml:
#   [project.entry-points."hmap.contact_proposers"]
#   from_above = "my_package:FromAbove"
plugins.register(plugins.CONTACT_PROPOSERS, "from_above", FromAbove)

scene = SceneBuilder("brick").add_robot("arm", "panda").add_box("table", [2, 2, 0.1], [0, 0, -0.05])
scene.add_box("brick", [0.08, 0.05, 0.06], [0.5, -0.2, 0.03], movable=True, mass=0.3)
scene.set_goal("brick", [0.5, 0.2, 0.03])

plan = planner.plan(scene.build(), proposer="from_above", time_limit=120.0)  # or proposer=FromAbove()
grasps = [segment for segment in plan.segments if segment.kind == ContactKind.GRASP]
print("contact:", np.round(grasps[0].contact_pose, 3) + 0.0)
