"""Fingers and what they may do: a push is one-sided, and the pads of a grasp reach over more than an edge."""

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.contacts import Contact
from hmap_core.validation.geometry import transform
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import Part, World

DIRECTIONS = 8  # along the face in which a pad is displaced


def check(world: World, contacts: list[Contact], findings: Findings) -> None:
    """Reports pushes by fingers that close on the object, and grasps by the edge of a pad; in physical mode only."""
    if world.document.mode != "physical":
        return
    for contact in contacts:
        if contact.by_tool or len(contact.touching) != 2:
            continue
        if contact.kind == "push":
            _check_one_sided(contact, findings)
        elif contact.kind == "grasp" and not contact.tool_grasp:
            _check_edge(contact, findings)


def _check_one_sided(contact: Contact, findings: Findings) -> None:
    """Checks that the fingers of a push, if both touch, press towards the same side."""
    k = contact.segment.first
    pairs = [_nearest(contact, parts, k) for parts in contact.touching.values()]
    if max(distance for distance, *_ in pairs) > limits.CONTACT_GAP:
        return
    (_, _, _, first), (_, _, _, second) = pairs
    angle = np.degrees(np.arccos(np.clip(first @ second, -1.0, 1.0)))
    findings.check(Kind.PUSH_NOT_ONE_SIDED, contact.bodies, contact.segment.start, angle, np.degrees(limits.ONE_SIDE))


def _check_edge(contact: Contact, findings: Findings) -> None:
    """Checks that each pad still touches the object if it is displaced along the face by ``limits.PAD_OFFSET``."""
    world, k = contact.world, contact.segment.first
    for parts in contact.touching.values():
        distance, part, _, normal = _nearest(contact, parts, k)
        if distance > limits.CONTACT_GAP:
            continue  # a missing contact is another violation
        track, objects = world.tracks[part], world.parts_of(contact.object)
        first, second = np.linalg.svd(normal[None])[2][1:]
        gaps = []
        for angle in 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            aside = limits.PAD_OFFSET * (np.cos(angle) * first + np.sin(angle) * second)
            T = transform(track.R[k], track.p[k] + aside)
            gaps.append(min(world.gauge(part, b).distance(T, world.tracks[b].at(k)) for b in objects))
        findings.check(Kind.GRASP_AT_EDGE, contact.bodies, contact.segment.start, max(gaps), limits.CONTACT_GAP)


def _nearest(contact: Contact, parts: list[Part], k: int) -> tuple[float, Part, Part, np.ndarray]:
    """The nearest parts of a finger and of the object: distance (m), both parts, normal (3,) into the object."""
    tracks = contact.world.tracks
    found = []
    for a in parts:
        for b in contact.world.parts_of(contact.object):
            distance, _, _, normal = contact.world.gauge(a, b).witness(tracks[a].at(k), tracks[b].at(k))
            found.append((distance, a, b, normal))
    return min(found, key=lambda entry: entry[0])
