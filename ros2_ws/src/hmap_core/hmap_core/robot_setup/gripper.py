"""Guess of a two-finger gripper: driven joints, finger links, pads and end-effector frame."""

from dataclasses import dataclass

import numpy as np

from hmap_core.kinematics.urdf import Urdf
from hmap_core.robot_description import Joint
from hmap_core.robot_setup.points import LinkPoints
from hmap_core.robot_setup.structure import Structure, independent
from hmap_core.scenes.grippers import JAW_CLEARANCE, MAX_MIDDLE_OFFSET
from hmap_core.transforms import from_matrix

MAX_DRIVERS = 2  # independent joints of a gripper that the guess understands
WAY_SAMPLES = 65  # joint values between the limits at which the gap is measured
BETWEEN = 0.1  # share of the distance from the middle to the outermost finger below which a finger is on no side
SNAP_CLOSING, SNAP_APPROACH = np.cos(np.deg2rad([20.0, 35.0]))  # an axis of the palm within this angle is taken
FACE = 1e-3  # m; points this near to the innermost one of a finger are of its inner face
MIN_FACE = 2e-3  # m; a narrower inner face is an edge
EDGE_HALF_WIDTH = 5e-3  # m, pad_half_width of a finger whose inner face is an edge
PAD_DEPTH = 0.015  # m, farthest that the end-effector frame is behind the ends of the fingers
FORCE = 40.0  # N, what two-finger grippers of arms for 3 to 14 kg press with
DIGITS = 6  # decimals of lengths and angles in a robot file


class NoGripper(Exception):
    """The fingers of a URDF are no gripper that hmap knows; the message says why."""


@dataclass(frozen=True)
class GripperGuess:
    """Values of a robot file.

    Attributes:
        link: that carries the end-effector frame.
        T_link_ee: (7,) that frame.
        joints: driven joints.
        closed, open: their values (k,) at both ends of the fingers' way, rad or m.
        sliding: whether all driven joints are prismatic.
        finger_links: one on each side.
        gaps: between the fingers at closed and open, m; negative in overlap.
        pad_half_width: m.
        pad_is_edge: whether the inner faces are edges, so that ``pad_half_width`` is a default.
    """

    link: str
    T_link_ee: np.ndarray
    joints: tuple[str, ...]
    closed: tuple[float, ...]
    open: tuple[float, ...]
    sliding: bool
    finger_links: tuple[str, str]
    gaps: tuple[float, float]
    pad_half_width: float
    pad_is_edge: bool

    def entry(self) -> dict[str, object]:
        """The values of the key ``gripper`` of a robot file."""
        values: dict[str, object] = {"joints": list(self.joints)}
        if self.sliding:
            closed_gap, open_gap = self.gaps
            per_joint = [(b - a) / (open_gap - closed_gap) for a, b in zip(self.closed, self.open, strict=True)]
            zero = [a - slope * closed_gap for a, slope in zip(self.closed, per_joint, strict=True)]
            values["per_joint"] = [round(v, DIGITS) for v in per_joint]
            values["at_zero"] = [round(v, DIGITS) + 0.0 for v in zero]
            values["min_opening"] = max(0.0, round(closed_gap, DIGITS))
            values["max_opening"] = round(open_gap - JAW_CLEARANCE, DIGITS)
            values["open_opening"] = round(open_gap, DIGITS)
        else:
            values["closed"] = [round(v, DIGITS) for v in self.closed]
            values["open"] = [round(v, DIGITS) for v in self.open]
        values["finger_links"] = list(self.finger_links)
        values["pad_half_width"] = round(self.pad_half_width, DIGITS)
        values["force"] = FORCE
        return values


def guess_gripper(urdf: Urdf, structure: Structure) -> GripperGuess:
    """Guesses the gripper below a palm.

    The fingers' centres give the closing direction, the joint limits both ends of their way, and the shapes that are
    innermost with the gripper closed the finger links and their pads.

    Args:
        urdf: the robot description.
        structure: its arm, palm and fingers.

    Returns:
        The guess.

    Raises:
        NoGripper: the fingers are not on two sides, or their joints are not understood.
    """
    return _Guess(urdf, structure).run()


class _Guess:
    def __init__(self, urdf: Urdf, structure: Structure):
        self._tree = urdf.tree
        self._structure = structure
        self._points = LinkPoints(urdf, structure.palm)
        self._branch = {link: self._branch_of(link) for link in urdf.hulls}
        self._solid = [link for link, branch in self._branch.items() if branch and self._points.has_shape(link)]
        self._drivers = [j for j in urdf.tree.by_name.values() if independent(j) and self._branch_of(j.child)]

    def run(self) -> GripperGuess:
        """Raises NoGripper as :func:`guess_gripper`."""
        self._check_drivers()
        middle = {joint.name: 0.5 * (joint.lower + joint.upper) for joint in self._drivers}
        tips = self._tips(middle)
        closing, sides = self._sides(tips, middle)
        closed, opened = {}, {}
        for joint in self._drivers:
            ends = joint.lower, joint.upper
            outwards = self._moves_outwards(joint, tips, middle, closing, sides)
            closed[joint.name], opened[joint.name] = ends if outwards else ends[::-1]
        approach = self._approach(tips, middle, closing)
        fingers = self._fingers(closed, closing, approach, sides)
        closed, opened = self._way(fingers, closed, opened, closing)
        fingers = self._fingers(closed, closing, approach, sides)
        axes = np.stack([np.cross(closing, approach), closing, approach], axis=1)
        origin, half_width, edge = self._pads(fingers, closed, axes)
        gaps = self._gap(fingers, closed, closing), self._gap(fingers, opened, closing)
        shift = self._middle(fingers, opened, closing) - self._middle(fingers, closed, closing)
        named = " and ".join(fingers)
        if gaps[1] - max(gaps[0], 0.0) <= 2.0 * JAW_CLEARANCE:
            raise NoGripper(
                f"between {named} are {gaps[0]:.4f} m with the fingers closed, {gaps[1]:.4f} m with them open"
            )
        if abs(shift) > MAX_MIDDLE_OFFSET:
            raise NoGripper(f"the middle between {named} moves by {shift:.4f} m as they open")
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = axes, origin
        names = tuple(joint.name for joint in self._drivers)
        return GripperGuess(
            self._structure.palm,
            from_matrix(T),
            names,
            tuple(closed[name] for name in names),
            tuple(opened[name] for name in names),
            all(joint.kind == "prismatic" for joint in self._drivers),
            fingers,
            gaps,
            half_width,
            edge,
        )

    def _branch_of(self, link: str) -> str:
        """The first finger joint above a link, by name; empty for links that no finger carries."""
        names = {joint.name for joint in self._structure.fingers}
        return next((joint.name for joint in self._tree.path(link) if joint.name in names), "")

    def _check_drivers(self) -> None:
        if not self._drivers:
            raise NoGripper("all finger joints mimic joints that are not in the gripper")
        names = ", ".join(joint.name for joint in self._drivers)
        if len(self._drivers) > MAX_DRIVERS:
            raise NoGripper(
                f"it has {len(self._drivers)} independent joints ({names}); in a linkage all but one need a <mimic>"
            )
        for joint in self._drivers:
            if not np.isfinite([joint.lower, joint.upper]).all() or joint.lower >= joint.upper:
                raise NoGripper(f"joint '{joint.name}' has no limits, which are the open and the closed gripper")

    def _tips(self, values: dict[str, float]) -> dict[str, str]:
        """For each branch with a shape, its last link: the one with the most joints above it, the farthest of these."""
        tips: dict[str, tuple[tuple[int, float], str]] = {}
        for link in self._solid:
            key = self._moving_above(link), float(np.linalg.norm(self._points.center(link, values)))
            if key > tips.get(self._branch[link], ((0, 0.0), ""))[0]:
                tips[self._branch[link]] = key, link
        if len(tips) < 2:
            raise NoGripper("its fingers have no collision shapes")
        return {branch: link for branch, (_, link) in tips.items()}

    def _moving_above(self, link: str) -> int:
        """Number of moving joints above a link."""
        return sum(joint.moves for joint in self._tree.path(link))

    def _sides(self, tips: dict[str, str], values: dict[str, float]) -> tuple[np.ndarray, dict[str, float]]:
        """The closing direction (3,), palm frame, and the side (1 or -1) of each branch along it."""
        centers = {branch: self._points.center(link, values) for branch, link in tips.items()}
        joints = {branch: self._moving_above(link) for branch, link in tips.items()}
        distal = [branch for branch in centers if joints[branch] == max(joints.values())]  # of a linkage, its fingers
        names = distal if len(distal) > 1 else list(centers)
        apart = [(float(np.linalg.norm(centers[a] - centers[b])), a, b) for a in names for b in names if a < b]
        widest, first, second = max(apart)
        if widest < FACE:
            raise NoGripper("its fingers are all at the same place")
        closing = _snapped((centers[first] - centers[second]) / widest, SNAP_CLOSING, np.eye(3))
        closing = closing * np.sign(closing[np.abs(closing).argmax()])  # of the two signs, that along the palm's axis
        middle = 0.5 * (centers[first] + centers[second])
        along = {branch: float((center - middle) @ closing) for branch, center in centers.items()}
        for branch, at in along.items():
            if abs(at) < BETWEEN * 0.5 * widest:
                raise NoGripper(f"finger joint '{branch}' is on neither side; hmap knows grippers with two sides")
        sides = {branch: float(np.sign(at)) for branch, at in along.items()}
        return closing, sides

    def _moves_outwards(self, joint: Joint, tips, middle, closing: np.ndarray, sides) -> bool:
        """Whether a driven joint opens the gripper towards its upper limit."""
        branch = self._branch_of(joint.child)
        if branch not in tips:
            raise NoGripper(f"joint '{joint.name}' moves no finger with a collision shape")
        lower, upper = (
            self._points.center(tips[branch], middle | {joint.name: value}) for value in (joint.lower, joint.upper)
        )
        return float((upper - lower) @ closing) * sides[branch] > 0.0

    def _approach(self, tips: dict[str, str], values: dict[str, float], closing: np.ndarray) -> np.ndarray:
        """The approach direction (3,), palm frame: from the last joint of the arm to the fingers."""
        centers = np.array([self._points.center(link, values) for link in tips.values()])
        start = self._points.frame(self._structure.arm[-1].child, values)[:3, 3]
        away = centers.mean(axis=0) - start
        away -= (away @ closing) * closing
        if np.linalg.norm(away) < FACE:
            raise NoGripper("its fingers are not in front of the last joint of the arm")
        axes = [self._points.frame(joint.child, values)[:3, :3] @ joint.axis for joint in self._structure.fingers]
        across = [np.cross(axis, closing) for axis in axes if np.linalg.norm(np.cross(axis, closing)) > SNAP_APPROACH]
        candidates = np.concatenate([np.eye(3), np.reshape(across, (-1, 3))])
        square = np.array([c for c in candidates if abs(c @ closing) < 1.0 - SNAP_CLOSING]).reshape(-1, 3)
        found = _snapped(away / np.linalg.norm(away), SNAP_APPROACH, square)
        found = found - (found @ closing) * closing
        return found / np.linalg.norm(found)

    def _fingers(self, closed, closing: np.ndarray, approach: np.ndarray, sides) -> tuple[str, str]:
        """The finger links: one on each side."""
        return (
            self._innermost(1.0, closed, closing, approach, sides),
            self._innermost(-1.0, closed, closing, approach, sides),
        )

    def _way(self, fingers: tuple[str, str], closed, opened, closing: np.ndarray):
        """The joint values between which the gap grows all the way: from where the fingers meet to the widest gap."""

        def at(share: float) -> dict[str, float]:
            return {name: closed[name] + share * (opened[name] - closed[name]) for name in closed}

        shares = np.linspace(0.0, 1.0, WAY_SAMPLES)
        gaps = [self._gap(fingers, at(share), closing) for share in shares]
        widest = int(np.argmax(gaps))
        first = widest
        while first > 0 and gaps[first] > 0.0 and gaps[first - 1] < gaps[first]:
            first -= 1
        return at(shares[first]), at(shares[widest])

    def _innermost(self, side: float, closed, closing: np.ndarray, approach: np.ndarray, sides) -> str:
        """The link of a side that reaches the farthest inwards with the gripper closed; of equals the foremost."""
        links = [link for link in self._solid if sides.get(self._branch[link]) == side]
        inner = {link: self._points.lowest(link, closed, side * closing) for link in links}
        equal = [link for link in links if inner[link] <= min(inner.values()) + FACE]
        return max(equal, key=lambda link: -self._points.lowest(link, closed, -approach))

    def _gap(self, fingers: tuple[str, ...], values, closing: np.ndarray) -> float:
        return sum(
            self._points.lowest(link, values, side * closing) for link, side in zip(fingers, (1.0, -1.0), strict=True)
        )

    def _middle(self, fingers: tuple[str, ...], values, closing: np.ndarray) -> float:
        """Coordinate (m) of the middle of the gap along the closing direction."""
        lower, upper = (
            self._points.lowest(link, values, side * closing) for link, side in zip(fingers, (1.0, -1.0), strict=True)
        )
        return 0.5 * (lower - upper)

    def _pads(self, fingers: tuple[str, ...], closed, axes: np.ndarray) -> tuple[np.ndarray, float, bool]:
        """Origin (3,) of the end-effector frame, half width of the pads (m), and whether the inner faces are edges."""
        lows, highs, inner, ends = [], [], [], []
        for link, side in zip(fingers, (1.0, -1.0), strict=True):
            swept = [(points @ axes, radius) for points, radius in self._points.of(link, closed)]
            face = min(float((side * points[:, 1]).min()) - radius for points, radius in swept)
            near = np.concatenate([points[side * points[:, 1] - radius <= face + FACE] for points, radius in swept])
            lows.append(near.min(axis=0)[[0, 2]])
            highs.append(near.max(axis=0)[[0, 2]])
            inner.append(side * face)
            ends.append(max(float(points[:, 2].max()) + radius for points, radius in swept))
        low, high = np.max(lows, axis=0), np.min(highs, axis=0)
        middle = 0.5 * (low + high)
        height = max(middle[1], min(ends) - PAD_DEPTH)
        width = float(high[0] - low[0])
        edge = width < MIN_FACE
        origin = axes @ np.array([middle[0], 0.5 * sum(inner), height])
        return origin, EDGE_HALF_WIDTH if edge else 0.5 * width, edge


def _snapped(direction: np.ndarray, cosine: float, axes: np.ndarray) -> np.ndarray:
    """The axis of ``axes`` (m, 3), with either sign, that a unit vector is nearest to; itself if none is near."""
    if not len(axes):
        return direction
    shares = axes @ direction
    best = int(np.abs(shares).argmax())
    return np.sign(shares[best]) * axes[best] if abs(shares[best]) >= cosine else direction
