"""All rows of one scene: makes the scene, asks its queries, labels the contacts."""

import zlib
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np

from hmap_core.contacts.feasibility import reach_bounds
from hmap_core.learning.families import family_of, make_scene
from hmap_core.learning.features import contact_features
from hmap_core.learning.hold_features import hold_features
from hmap_core.learning.labels import REASONS, Labels, Stage, label_contacts
from hmap_core.learning.motions import label_motion
from hmap_core.learning.scene_queries import SceneQuery, scene_queries
from hmap_core.learning.situation import PathSituation
from hmap_core.planner.contact_checker import cleared
from hmap_core.planner.obstruction import without
from hmap_core.planner.protocols import ContactQuery
from hmap_core.planner.sampled_contacts import SampledContacts, sampled_surface
from hmap_core.types import ContactPoint

RANKED = 64  # contacts of a query that the sampler would try first
UNIFORM = 64  # contacts of a query that are drawn uniformly
ARMS = 24  # contacts of a query for which the arm is evaluated
SEGMENTS = 2  # contacts of a scene for which a motion is planned
EXECUTED_EVERY = 5  # scenes, of which in one a valid motion is executed
CLOUD = 128  # points of an object's cloud in the table of queries
SHARES = ((80, "train"), (90, "validation"), (100, "test"))  # per cent, cumulated
MANTISSA = 0xFFFFF000  # bits of a float32 that features keep


@dataclass
class SceneRows:
    """The rows of one scene, as columns of the tables in :mod:`hmap_core.learning.schema`."""

    split: str
    scene: dict[str, Any]
    contacts: list[dict[str, Any]] = field(default_factory=list)
    queries: list[dict[str, Any]] = field(default_factory=list)


def split_of(family: str, seed: int) -> str:
    """The split of a scene: decided by its family and its own seed, so it never changes."""
    draw = zlib.crc32(f"split {family} {seed}".encode()) % 100
    return next(name for share, name in SHARES if draw < share)


def rounded(values: np.ndarray) -> np.ndarray:
    """Float32 values with fewer bits, which compress better."""
    bits = np.ascontiguousarray(values, np.float32).view(np.uint32) & np.uint32(MANTISSA)
    return bits.view(np.float32)


def scene_rows(number: int, seed: int, families: tuple[str, ...], leave_out: bool = False) -> SceneRows:
    """All rows of the scene with a number in the data set of a seed.

    Args:
        number: of the scene.
        seed: of the data set.
        families: they take turns.
        leave_out: whether what may be removed is left out; a scene without such bodies has no rows then.
    """
    family, own = family_of(number, families), seed + number // len(families)
    split = split_of(family, own)
    about: dict[str, Any] = {"scene": number, "family": family, "seed": own, "split": split, "contacts": 0}
    made = make_scene(family, own)
    if made is None:
        return SceneRows(split, about | {"status": "no scene", "task": ""})
    scene, text = made
    if leave_out and not scene.removable:
        return SceneRows(split, about | {"status": "nothing to remove", "task": text})
    if leave_out:
        scene, text = without(scene, set(scene.removable)), "# without what may be removed\n" + text
    rng = np.random.default_rng((seed, number))
    rows = SceneRows(split, about | {"status": "no path", "task": text})
    planned = 0
    for k, asked in enumerate(scene_queries(scene, rng)):
        contacts, ranks, more = contacts_of(asked.query)
        labels = label_contacts(asked.query, contacts, ARMS)
        own_rows = _contact_rows(number, k, family, asked, contacts, ranks, labels)
        if asked.grasp is None and not asked.on_tool and planned < SEGMENTS:
            feasible = sorted(labels.keyframes)
            if feasible:
                one = int(feasible[int(rng.integers(len(feasible)))])
                executed = number % EXECUTED_EVERY == 0
                found = label_motion(
                    asked.query, contacts[one], labels.keyframes[one], int(rng.integers(2**31)), executed
                )
                own_rows[one] |= {
                    "stage": int(found.stage),
                    "stage_name": found.stage.name.lower(),
                    "reason": found.reason,
                    "position_error": _number(found.position_error),
                    "rotation_error": _number(found.rotation_error),
                }
                planned += 1
        rows.contacts += own_rows
        rows.queries.append(_query_row(number, k, family, asked, labels, more))
    rows.scene |= {"status": "made" if rows.queries else "no path", "contacts": len(rows.contacts)}
    return rows


def contacts_of(query: ContactQuery) -> tuple[list[ContactPoint], list[int], list[ContactPoint]]:
    """Contacts of a query, their places in the order of the sampler, and the rest of the sampler's first batch.

    The place is -1 for those that are drawn uniformly.
    """
    first = [c for batch in islice(SampledContacts().propose(query), 1) for c in batch.contacts]
    ranked = first[:RANKED]
    uniform = [c for batch in islice(SampledContacts(uniform=True).propose(query), 1) for c in batch.contacts][:UNIFORM]
    return ranked + uniform, [*range(len(ranked)), *[-1] * len(uniform)], first[RANKED:]


def _contact_rows(
    number: int, k: int, family: str, asked: SceneQuery, contacts: list[ContactPoint], ranks: list[int], labels: Labels
) -> list[dict[str, Any]]:
    """The rows of the contacts of one query."""
    query = asked.query
    situation = PathSituation.of(query.scene, query.state, query.object, query.object_poses, query.robot)
    seen = rounded(contact_features(situation, contacts))
    rows = []
    for c, contact in enumerate(contacts):
        stage = Stage(int(labels.stage[c]))
        rows.append(
            {
                "scene": number,
                "query": k,
                "candidate": c,
                "family": family,
                "robot": query.robot,
                "with_tool": asked.grasp is not None,
                "on_tool": asked.on_tool,
                "source": "uniform" if ranks[c] < 0 else "ranked",
                "rank": ranks[c],
                "kind": str(contact.kind),
                "T_obj_ee": contact.T_obj_ee.astype(np.float32),
                "point": contact.point.astype(np.float32),
                "normal": contact.normal.astype(np.float32),
                "approach": contact.approach.astype(np.float32),
                "opening": contact.opening,
                "score": contact.score,
                "poses": len(query.object_poses) - 1,
                "bound": int(labels.bound[c]),
                "reach": int(labels.reach[c]),
                "arm_evaluated": bool(labels.checked[c]),
                "stage": int(stage),
                "stage_name": stage.name.lower(),
                "reason": REASONS[stage],
                "position_error": None,
                "rotation_error": None,
                "features": seen[c],
            }
        )
    return rows


def _query_row(
    number: int, k: int, family: str, asked: SceneQuery, labels: Labels, more: list[ContactPoint]
) -> dict[str, Any]:
    """The row of one query; ``more`` are contacts that count for how far it serves, but have no rows."""
    query, grasp = asked.query, asked.grasp
    bound = int(labels.bound.max(initial=-1))
    if more:
        manipulation, _ = cleared(query.scene, query.state, query.object, query.robot)
        bound = max(bound, int(reach_bounds(manipulation, more, query.object_poses).max()))
    situation = PathSituation.of(query.scene, query.state, query.object, query.object_poses, query.robot)
    boxes = situation.boxes
    around = np.concatenate([boxes.R.reshape(-1, 9), boxes.p, boxes.half], axis=1)
    cloud = sampled_surface(query.scene, query.state, query.object, query.object_poses[0], query.rng)
    hold = np.zeros(0) if grasp is None else grasp.contact.contact.T_obj_ee
    return {
        "scene": number,
        "query": k,
        "family": family,
        "robot": query.robot,
        "robot_model": query.scene.robots[query.robot].model.name,
        "object": query.object,
        "tool": "" if grasp is None else grasp.tool,
        "on_tool": asked.on_tool,
        "T_tool_ee": np.asarray(hold, np.float32),
        "start": asked.start,
        "object_poses": query.object_poses.astype(np.float32).ravel(),
        "object_cloud": rounded(cloud.points[:CLOUD]).ravel(),
        "around": rounded(around).ravel(),
        "T_world_base": situation.robot.base_pose.astype(np.float32),
        "contacts": len(labels.stage),
        "best_bound": bound,
        "best_reach": int(labels.reach.max(initial=-1)),
        "features": rounded(hold_features(situation)),
    }


def _number(value: float) -> float | None:
    return None if np.isnan(value) else value
