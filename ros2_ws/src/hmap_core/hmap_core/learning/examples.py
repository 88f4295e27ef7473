"""What the model is trained on and measured by: features and targets of contacts and of manipulators."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pyarrow.compute as pc

from hmap_core.exceptions import InputError
from hmap_core.learning.labels import Stage
from hmap_core.learning.schema import SPLITS
from hmap_core.learning.situation import FIRST_PLACE
from hmap_core.learning.tables import columns, read, shards

UNKNOWN = -1
NEXT_FOLDER = 1 << 48  # added to numbers of queries and places, so that those of several data sets differ
CONTACT_COLUMNS = (
    "scene", "query", "family", "rank", "score", "kind", "with_tool", "on_tool", "poses", "bound", "stage", "features",
    "T_obj_ee",
)  # fmt: skip


@dataclass(frozen=True)
class Contacts:
    """N contacts.

    Attributes:
        features: (N, F).
        hand: (N,) whether the rigid hand serves enough poses.
        feasible: (N,) 1 feasible, 0 not, UNKNOWN: the arm was not evaluated.
        share: (N,) of the path that the rigid hand serves.
        query: (N,) number of the query, increasing.
        rank: (N,) place in the order of the sampler, -1 for uniform contacts.
        score: (N,) of the sampler.
        family: (N,).
        frames: (N, 7) the contacts.
    """

    features: np.ndarray
    hand: np.ndarray
    feasible: np.ndarray
    share: np.ndarray
    query: np.ndarray
    rank: np.ndarray
    score: np.ndarray
    family: np.ndarray
    frames: np.ndarray

    def __len__(self) -> int:
        return len(self.query)

    def __getitem__(self, keep: np.ndarray) -> "Contacts":
        return Contacts(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    @property
    def known(self) -> np.ndarray:
        """(N,) where feasibility is known."""
        return self.feasible != UNKNOWN


@dataclass(frozen=True)
class Holds:
    """N manipulators: bare hands and held tools.

    Attributes:
        features: (N, F).
        serves: (N,) whether the arm, with some contact, serves at least FIRST_PLACE poses, or the whole path.
        share: (N,) of the path that the rigid hand serves with the best contact.
        place: (N,) which scene, robot and pose of the path: manipulators of the same place are compared.
        tool: (N,) whether a tool is held.
        family: (N,).
    """

    features: np.ndarray
    serves: np.ndarray
    share: np.ndarray
    place: np.ndarray
    tool: np.ndarray
    family: np.ndarray

    def __len__(self) -> int:
        return len(self.serves)

    def __getitem__(self, keep: np.ndarray) -> "Holds":
        return Holds(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))


Rows = TypeVar("Rows", Contacts, Holds)


def joined(parts: Sequence[Rows]) -> Rows:
    """Contacts, or manipulators, of several splits or data sets as one."""
    first = parts[0]
    names = [field.name for field in fields(first)]
    return (
        first
        if len(parts) == 1
        else replace(first, **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
    )


def thinned(contacts: Contacts, kept: float, seed: int) -> Contacts:
    """Contacts with a share of those where the rigid hand does not serve, which are nine of ten and look alike."""
    if kept >= 1.0:
        return contacts
    return contacts[contacts.hand | (np.random.default_rng(seed).random(len(contacts)) < kept)]


def load_all(folders: Sequence[Path], split: str, families: tuple[str, ...] | None = None) -> tuple[Contacts, Holds]:
    """The contacts and manipulators of a split of several data sets; raises as :func:`load_contacts`."""
    contacts, holds = [], []
    for number, folder in enumerate(folders):
        own, held = load_contacts(folder, split, families), load_holds(folder, split, families)
        contacts.append(replace(own, query=own.query + number * NEXT_FOLDER))
        holds.append(replace(held, place=held.place + number * NEXT_FOLDER))
    return joined(contacts), joined(holds)


def load_contacts(folder: Path, split: str, families: tuple[str, ...] | None = None) -> Contacts:
    """The contacts of a split.

    Args:
        folder: of the data set.
        split: one of SPLITS.
        families: only of these; None: of all.

    Raises:
        InputError: a shard is missing, truncated, or of another schema.
    """
    rows = columns(shards(folder, "contacts", split), CONTACT_COLUMNS)
    stage, poses = rows["stage"].astype(int), np.maximum(rows["poses"].astype(float), 1.0)
    hand = stage >= Stage.HAND_SERVES
    feasible = np.where(stage == Stage.HAND_SERVES, UNKNOWN, (stage >= Stage.FEASIBLE).astype(int))
    share = np.where(rows["poses"] > 0, np.maximum(rows["bound"], 0) / poses, (rows["bound"] >= 0).astype(float))
    key = rows["scene"].astype(np.int64) * 4096 + rows["query"]
    found = Contacts(
        rows["features"], hand, feasible, share.astype(np.float32), key, rows["rank"], rows["score"],
        rows["family"].astype(str), rows["T_obj_ee"],
    )  # fmt: skip
    return found if families is None else found[np.isin(found.family, families)]


def load_holds(folder: Path, split: str, families: tuple[str, ...] | None = None) -> Holds:
    """The manipulators of a split; raises as :func:`load_contacts`."""
    paths = shards(folder, "queries", split)
    names = ("scene", "start", "family", "robot", "tool", "on_tool", "contacts", "best_bound", "best_reach", "features")
    rows = columns(paths, names)
    lengths = np.concatenate([pc.list_value_length(read(p, ["object_poses"]).column(0)).to_numpy() for p in paths])
    last = np.maximum(lengths // 7 - 1, 1)
    serves = rows["best_reach"] >= np.minimum(FIRST_PLACE, last)
    share = np.maximum(rows["best_bound"], 0) / last
    robots = np.unique(rows["robot"].astype(str), return_inverse=True)[1]
    place = (rows["scene"].astype(np.int64) * 8 + robots) * 4096 + rows["start"]
    found = Holds(
        rows["features"], serves, share.astype(np.float32), place, rows["tool"].astype(str) != "",
        rows["family"].astype(str),
    )  # fmt: skip
    keep = ~rows["on_tool"].astype(bool)
    return found[keep if families is None else keep & np.isin(found.family, families)]


def family_weights(family: np.ndarray) -> np.ndarray:
    """Weights (N,) with mean 1 so that all families count alike."""
    names, index, count = np.unique(family, return_inverse=True, return_counts=True)
    return (len(family) / len(names) / count)[index].astype(np.float32)


def check_split(split: str) -> str:
    """A split as given.

    Raises:
        InputError: there is no such split.
    """
    if split not in SPLITS:
        raise InputError(f"unknown split {split!r}; there are {', '.join(SPLITS)}")
    return split
