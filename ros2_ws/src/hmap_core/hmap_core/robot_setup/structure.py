"""Which joints of a URDF are the arm, and which link carries the fingers."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.urdf import Urdf
from hmap_core.robot_description import Joint
from hmap_core.scenes.fields import did_you_mean

MAX_FINGER_JOINTS = 3  # independent joints of a branch beyond which it is an arm, not a finger
JAW_WORDS = ("gripper", "jaw", "finger", "claw", "hand")  # in the name of a last joint that closes a jaw
TIP_WORDS = ("tcp", "tool0", "tool", "ee", "eef", "end_effector", "flange", "tip")  # in the name of a frame at the tip


@dataclass(frozen=True)
class Structure:
    """Arm and palm of a robot.

    Attributes:
        arm: joints of the arm, base to tip.
        palm: link that carries the fingers; the link at the tip of an arm without gripper.
        fingers: the nearest moving joints below the palm; empty without gripper.
        others: independent joints that are neither in the arm nor below the palm; they stay at 0.
        notes: what was assumed, for people.
    """

    arm: tuple[Joint, ...]
    palm: str
    fingers: tuple[Joint, ...]
    others: tuple[Joint, ...]
    notes: tuple[str, ...]


def find_structure(urdf: Urdf, file: Path, tip: str | None = None) -> Structure:
    """Finds the arm and the palm.

    The palm is the link with the most independent joints above it, at least two moving branches below it, and in no
    branch more joints than a finger has. The arm are the independent joints from the root to the palm. Without such a
    link, the arm is the longest chain of independent joints.

    Args:
        urdf: the robot description.
        file: its path, for error messages.
        tip: the link to use as the palm, or as the tip of an arm without gripper; None: the search decides.

    Returns:
        The structure.

    Raises:
        InputError: INVALID_SCENE; ``tip`` is unknown, or no joint moves it.
    """
    tree = _Branches(urdf)
    if tip is not None and tip not in urdf.hulls:
        known = ", ".join(urdf.hulls)
        raise InputError(
            f"{file}: --tip {tip}: no such link.{did_you_mean(tip, list(urdf.hulls))} It has: {known}",
            Code.INVALID_SCENE,
        )
    if not any(tree.depth(link) for link in urdf.hulls):
        raise InputError(
            f"{file}: no joint moves: an arm needs joints of type revolute, continuous or prismatic without <mimic>",
            Code.INVALID_SCENE,
        )
    notes: list[str] = []
    head = tip if tip is not None else _palm_or_tip(tree, notes)
    if not tree.depth(head):
        raise InputError(f"{file}: no independent joint moves link '{head}', so it ends no arm", Code.INVALID_SCENE)
    arm = tuple(joint for joint in urdf.tree.path(head) if independent(joint))
    fingers = tuple(tree.branches(head))
    if fingers:
        parents = {joint.parent for joint in fingers}
        palm = parents.pop() if len(parents) == 1 else head
    elif tip is None and (jaw := _single_jaw(arm)) is not None:
        notes.append(f"joint '{jaw.name}' moves a single jaw, which hmap does not grip with: it stays at 0")
        arm, palm = arm[:-1], jaw.parent
    else:
        palm = head if tip is not None else _tip_frame(tree, head)
    below = {joint.name for joint in tree.below(head)}
    used = below | {joint.name for joint in arm}
    others = tuple(joint for joint in urdf.tree.by_name.values() if independent(joint) and joint.name not in used)
    return Structure(arm, palm, fingers, others, tuple(notes))


def independent(joint: Joint) -> bool:
    """Whether a joint moves and mimics no other."""
    return joint.moves and joint.mimic is None


class _Branches:
    """The tree of a URDF from the links downwards."""

    def __init__(self, urdf: Urdf):
        self.urdf = urdf
        self._children: dict[str, list[Joint]] = {link: [] for link in urdf.hulls}
        for joint in urdf.tree.by_child.values():
            self._children.setdefault(joint.parent, []).append(joint)
        self._depths: dict[str, int] = {}

    def depth(self, link: str) -> int:
        """Number of independent joints above a link."""
        above = self.urdf.tree.path(link, self._depths)
        depth = self._depths.get(above[0].parent if above else link, 0)
        for joint in above:
            depth += independent(joint)
            self._depths[joint.child] = depth
        return depth

    def branches(self, link: str) -> Iterator[Joint]:
        """The nearest moving joints below a link."""
        return (joint for joint in self._walk(link, lambda joint: not joint.moves) if joint.moves)

    def below(self, link: str) -> Iterator[Joint]:
        """All joints below a link."""
        return self._walk(link, lambda joint: True)

    def _walk(self, link: str, on: Callable[[Joint], bool]) -> Iterator[Joint]:
        """The joints below a link, and below those for which ``on`` is true, each before those below it."""
        left = self._children[link][::-1]
        while left:
            joint = left.pop()
            yield joint
            if on(joint):
                left += self._children[joint.child][::-1]

    def heads(self) -> list[str]:
        """The links that a moving joint carries directly."""
        return [joint.child for joint in self.urdf.tree.by_child.values() if joint.moves]

    def rigid(self, link: str) -> Iterator[str]:
        """A link and all that are fixed to it, downwards."""
        yield link
        for joint in self._walk(link, lambda joint: not joint.moves):
            if not joint.moves:
                yield joint.child


def _palm_or_tip(tree: _Branches, notes: list[str]) -> str:
    heads = tree.heads()
    palms = [link for link in heads if tree.depth(link) and _is_palm(tree, link)]
    found = palms or heads
    deepest = max(tree.depth(link) for link in found)
    chosen = next(link for link in found if tree.depth(link) == deepest)
    rivals = [link for link in found if tree.depth(link) == deepest and link != chosen]
    if rivals:
        what = "carry fingers" if palms else "end chains of the same length"
        notes.append(f"{', '.join(rivals)} {what}, too: choose one by --tip")
    return chosen


def _is_palm(tree: _Branches, link: str) -> bool:
    branches = list(tree.branches(link))
    if len(branches) < 2:
        return False
    counts = (independent(b) + sum(independent(joint) for joint in tree.below(b.child)) for b in branches)
    return max(counts) <= MAX_FINGER_JOINTS


def _single_jaw(arm: tuple[Joint, ...]) -> Joint | None:
    """The last joint of a chain if its name says that it closes a jaw."""
    last = arm[-1]
    named = f"{last.name} {last.child}".lower()
    return last if len(arm) > 1 and any(word in named for word in JAW_WORDS) else None


def _tip_frame(tree: _Branches, head: str) -> str:
    """The frame of a tool among the links that are fixed to the last one; else the last one."""
    frames = [link for link in tree.rigid(head) if link != head and not tree.urdf.hulls[link]]
    for word in TIP_WORDS:
        for link in frames:
            if word in link.lower().replace("-", "_").split("_"):
                return link
    return head
