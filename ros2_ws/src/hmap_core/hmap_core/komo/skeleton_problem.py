"""From a skeleton in a workspace to the KOMO problem of its path."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from types import MappingProxyType

import numpy as np

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.exceptions import InputError
from hmap_core.komo.clearances import Clearances
from hmap_core.komo.features import above, joint_position, pose_params_all, relative_pose, relative_position
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import SolverOptions
from hmap_core.komo.skeleton import Skeleton, SkeletonEntry, Symbol
from hmap_core.komo.timeline import Place, Timeline
from hmap_core.komo.transcription import KomoProblem
from hmap_core.komo.workspace import Workspace
from hmap_core.transforms import IDENTITY, apply, consistent, multiply, multiply_all


class SkeletonProblem(KomoProblem):
    """The path problem of a skeleton: its modes as constraints, and everything else kept apart.

    A manipulator meets what it touches (eq. 3 of the paper), what is stable on it hangs rigidly on its frame and is no
    variable of its own (eq. 2d), ``pose_eq``, ``position_eq``, ``above`` and ``home`` hold at their steps.

    Args:
        skeleton: its text.
        workspace: scene, state, and the robots that move.
        steps_per_phase: one number for all phases, or one for each. The phases before the first entry may have none:
            the problem is then the part of another one that begins later.
        options: of the solver.
        start: world poses (7,) of bodies that do not start where they are in the workspace's state.
        collisions: what keeps apart, where that is known already; by default it follows from the modes.

    Raises:
        InputError: names the entry that does not fit the scene or the other entries.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        workspace: Workspace,
        steps_per_phase: int | Sequence[int],
        options: SolverOptions | None = None,
        start: Mapping[str, np.ndarray] = MappingProxyType({}),
        collisions: CollisionModel | None = None,
    ):
        each = steps_per_phase if isinstance(steps_per_phase, Iterable) else [steps_per_phase] * skeleton.phases
        steps = tuple(each)
        begin = int(np.ceil(min(entry.phase0 for entry in skeleton.entries))) - 1  # phase of the first entry
        if len(steps) != skeleton.phases or min(steps[:begin], default=0) < 0 or min(steps[max(begin, 0) :]) < 1:
            raise InputError(f"steps_per_phase {steps}: the skeleton has {skeleton.phases} phases, of 1 step or more")
        self.skeleton, self.workspace = skeleton, workspace
        self.timeline = Timeline(skeleton, workspace, start)
        if collisions is None:
            collisions = Clearances(self.timeline).model()
        super().__init__(workspace.model.chain, steps, collisions, options or SolverOptions())
        self._phase = self.phase_of_step().tolist()
        for entry in skeleton.entries:
            _ADD[entry.symbol](self, entry)

    # --- times

    def step(self, phase: float) -> int:
        """The step that a phase ends with; -1 for phase 0, the start. Fractions are rounded to a step."""
        whole = int(phase)
        last = sum(self.steps_per_phase[:whole]) - 1
        return last if whole == phase else last + round((phase - whole) * self.steps_per_phase[whole])

    def steps_of(self, entry: SkeletonEntry) -> range:
        """The steps at which an entry holds."""
        return range(max(0, self.step(entry.phase0)), self.step(entry.phase1) + 1)

    def _by_phase(self, steps: Iterable[int]) -> Iterator[tuple[int, Iterator[int]]]:
        """Phases, each with those of the ascending steps that lie in it."""
        return groupby(steps, self._phase.__getitem__)

    def _pairs(self, entry: SkeletonEntry) -> list[tuple[Place, Place, list[int]]]:
        """Where the entry's frame and its reference are at its steps, as far as one moves against the other."""
        found: dict[tuple[int, int], tuple[Place, Place, list[int]]] = {}
        for phase, steps in self._by_phase(self.steps_of(entry)):
            a = self.timeline.place(entry.frames[0], phase)
            b = self.timeline.place(entry.frames[1], phase) if len(entry.frames) > 1 else _WORLD
            if a.frame != b.frame:
                found.setdefault((id(a), id(b)), (a, b, []))[2].extend(steps)
        if not found:
            entry.reject("nothing holds it then, so that it could move")
        return list(found.values())

    # --- objectives; their steps are those of phases that there are, so that there is nothing to check

    def _add_touch(self, entry: SkeletonEntry) -> None:
        self._meet(entry, self.steps_of(entry))

    def _add_stable(self, entry: SkeletonEntry) -> None:
        """The mode switch: where the object was before, the manipulator meets it."""
        touches = (e for e in self.skeleton.of(Symbol.TOUCH) if e.frames == entry.frames)
        if entry.phase0 > 0 and not any(e.phase0 <= entry.phase0 <= e.phase1 for e in touches):
            self._meet(entry, [self.step(entry.phase0)])

    def _meet(self, entry: SkeletonEntry, steps: Iterable[int]) -> None:
        """The manipulator at its contact with the object, at the steps at which this does not hang on it so already."""
        manipulator, name = entry.frames
        T_contact = self.timeline.T_obj_manipulator(entry)
        met: dict[tuple[int, int], tuple[Place, Place, list[int]]] = {}
        for phase, own in self._by_phase(steps):
            holder = self.skeleton.stable_on(name, phase)
            if holder is not None and holder.frames == entry.frames:
                T_held = self.timeline.T_obj_manipulator(holder)
                if T_held is T_contact or np.allclose(T_contact, T_held):
                    continue
            hand, touched = self.timeline.place(manipulator, phase), self.timeline.place(name, phase)
            if hand.frame == touched.frame:
                entry.reject(f"nothing moves '{manipulator}' against '{name}' in phase {phase + 1}")
            met.setdefault((id(hand), id(touched)), (hand, touched, []))[2].extend(own)
        for hand, touched, steps in met.values():
            feature = relative_pose(hand.frame, hand.T, multiply(touched.T, T_contact), touched.frame)
            self.objectives.append(Objective(feature, ObjectiveType.EQ, steps))

    def _add_pose(self, entry: SkeletonEntry) -> None:
        pairs = self._pairs(entry)
        rows = _rows(entry, pairs)
        for a, b, steps in pairs:
            if entry.target.ndim == 1:
                feature = relative_pose(a.frame, a.T, multiply(b.T, entry.target), b.frame)
                self.objectives.append(Objective(feature, ObjectiveType.EQ, steps))
            else:
                targets = multiply_all(b.T, np.array([rows[s] for s in steps]))
                feature = relative_pose(a.frame, a.T, targets[0], b.frame)
                self.objectives.append(
                    Objective(feature, ObjectiveType.EQ, steps, params=pose_params_all(a.T, targets))
                )

    def _add_position(self, entry: SkeletonEntry) -> None:
        pairs = self._pairs(entry)
        rows = _rows(entry, pairs)
        for a, b, steps in pairs:
            targets = apply(b.T, np.array([rows[s] for s in steps]))
            feature = relative_position(a.frame, a.T[:3], targets[0], b.frame)
            params = np.concatenate([np.tile(a.T[:3], (len(steps), 1)), targets], axis=1)
            self.objectives.append(Objective(feature, ObjectiveType.EQ, steps, params=params))

    def _add_above(self, entry: SkeletonEntry) -> None:
        name, support = entry.frames
        T_up, bottom = self.workspace.upright(name)
        T_top, half_size = self.workspace.top(support)
        for a, b, steps in self._pairs(entry):
            standing, within = above(a.frame, multiply(a.T, T_up), bottom, multiply(b.T, T_top), half_size, b.frame)
            self.objectives.append(Objective(standing, ObjectiveType.EQ, steps))
            self.objectives.append(Objective(within, ObjectiveType.INEQ, steps))

    def _add_home(self, entry: SkeletonEntry) -> None:
        robots = self.workspace.robots
        if entry.frames != robots:
            entry.reject(f"is for all robots that move, in their order: {', '.join(robots)}")
        home = np.concatenate([self.workspace.scene.robots[name].model.home for name in robots])
        target = home if entry.target is None else np.asarray(entry.target, float)
        steps = self.steps_of(entry)
        if target.shape == (len(steps), len(home)):
            features = [joint_position(row) for row in target]
            params = np.array([feature.params for feature in features])
            self.objectives.append(Objective(features[0], ObjectiveType.EQ, steps, params=params))
            return
        if target.shape != home.shape:
            entry.reject(f"its target must be {len(home)} joints, or a row of them for each of its {len(steps)} steps")
        self.objectives.append(Objective(joint_position(target), ObjectiveType.EQ, steps))

    # --- results

    def object_poses(self, path: np.ndarray) -> dict[str, np.ndarray]:
        """World poses (T, 7) of the handled bodies along a path (T, n), with quaternions that never turn round."""
        path = np.asarray(path, float)
        if path.shape != (self.steps, self.chain.parent.shape[0]):
            raise InputError(f"path of shape {path.shape}; it must be ({self.steps}, {len(self.chain.parent)})")
        hands = {name: self.workspace.end_effectors(name, path) for name in self.workspace.robots}
        found = {}
        for name in self.timeline.handled:
            poses = np.empty((self.steps, 7))
            for place, phases in self.timeline.runs(name):
                span = slice(self.step(phases.start) + 1, self.step(phases.stop) + 1)
                poses[span] = place.T_ee if place.robot is None else multiply_all(hands[place.robot][span], place.T_ee)
            first = self.timeline.start[name]
            found[name] = consistent(np.concatenate([first[None], poses]))[1:]
        return found


_WORLD = Place(0, IDENTITY, None, IDENTITY)
_ADD = {
    Symbol.TOUCH: SkeletonProblem._add_touch,
    Symbol.STABLE: SkeletonProblem._add_stable,
    Symbol.POSE_EQ: SkeletonProblem._add_pose,
    Symbol.POSITION_EQ: SkeletonProblem._add_position,
    Symbol.ABOVE: SkeletonProblem._add_above,
    Symbol.HOME: SkeletonProblem._add_home,
}


def _rows(entry: SkeletonEntry, pairs: list[tuple[Place, Place, list[int]]]) -> dict[int, np.ndarray]:
    """The target of each step."""
    steps = [s for _, _, own in pairs for s in own]
    if entry.target.ndim == 1:
        return dict.fromkeys(steps, entry.target)
    if len(entry.target) != len(steps):
        entry.reject(f"has {len(entry.target)} targets for {len(steps)} steps")
    return dict(zip(sorted(steps), entry.target, strict=True))
