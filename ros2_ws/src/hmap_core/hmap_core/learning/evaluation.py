"""How good a model is at ordering contacts: on the scenes of a split, or on a family that it was not trained on."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.learning.baselines import BASELINES, Scorer
from hmap_core.learning.examples import Contacts, joined, load_contacts, load_holds
from hmap_core.learning.metrics import average_precision, calibration_error, first_hits, intervals
from hmap_core.learning.network import ContactModel

LEARNED = "learned"
TOP = 5
DRAWS = 200  # of the bootstrap of the area under the precision-recall curve


@dataclass(frozen=True)
class Score:
    """What was measured of one scorer on some queries that have a feasible contact; intervals of 95 %.

    Attributes:
        scorer: its name.
        family: of the queries; ``all`` for several.
        queries, contacts: how many.
        top_1, top_5: share of the queries whose best contact, or one of the five best, is feasible: mean, interval.
        checks: contacts that are checked until one is feasible: mean, lower, upper.
        precision: area under the precision-recall curve over all contacts: value, lower, upper.
        calibration: expected calibration error; None where the scores are no probabilities.
    """

    scorer: str
    family: str
    queries: int
    contacts: int
    top_1: tuple[float, float, float]
    top_5: tuple[float, float, float]
    checks: tuple[float, float, float]
    precision: tuple[float, float, float]
    calibration: float | None

    def to_dict(self) -> dict:
        """As plain JSON types."""
        return asdict(self)


def measure(name: str, family: str, contacts: Contacts, score: np.ndarray, probability: bool, seed: int = 0) -> Score:
    """Measure scores (N,) of contacts; only those whose feasibility is known count."""
    known = contacts.known
    contacts, score = contacts[known], score[known]
    rng = np.random.default_rng(seed)
    hits = np.array(list(first_hits(contacts.query, contacts.feasible, score).values()), float)
    area = average_precision(contacts.feasible, score)
    low, high = _interval(contacts, score, rng)
    error = calibration_error(contacts.feasible.astype(float), score) if probability else None
    return Score(
        name, family, len(hits), len(contacts), intervals((hits <= 1).astype(float), rng),
        intervals((hits <= TOP).astype(float), rng), intervals(hits, rng), (area, low, high), error,
    )  # fmt: skip


def _interval(contacts: Contacts, score: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """Bootstrap interval of the average precision over queries."""
    names, index = np.unique(contacts.query, return_inverse=True)
    rows = np.split(np.argsort(index, kind="stable"), np.cumsum(np.bincount(index))[:-1])
    drawn = []
    for _ in range(DRAWS):
        chosen = np.concatenate([rows[k] for k in rng.integers(0, len(names), len(names))])
        drawn.append(average_precision(contacts.feasible[chosen], score[chosen]))
    low, high = np.nanquantile(drawn, [0.025, 0.975])
    return float(low), float(high)


def model_scorer(model: ContactModel) -> Scorer:
    """The calibrated probabilities of a model."""
    return lambda contacts: model.feasible(contacts.features)[0]


def evaluate(folder: Path, model: ContactModel, split: str, seed: int = 0) -> list[Score]:
    """Compare a model with all baselines on a split.

    Raises:
        InputError: the data set lacks the split.
    """
    train, test = load_contacts(folder, "train"), load_contacts(folder, split)
    scorers = {LEARNED: model_scorer(model)} | {name: make(train, seed) for name, make in BASELINES.items()}
    return compared(test, "all", scorers)


def compared(test: Contacts, family: str, scorers: dict[str, Scorer]) -> list[Score]:
    """Measure several scorers on the same contacts.

    Raises:
        InputError: no contact is feasible.
    """
    if not (test.feasible == 1).any():
        raise InputError(f"no contact of the family '{family}' is feasible: there is nothing to measure")
    return [measure(name, family, test, score(test), name == LEARNED) for name, score in scorers.items()]


def leave_one_out(
    folder: Path, train: Callable[[Path, str], ContactModel], families: Sequence[str], seed: int = 0
) -> list[Score]:
    """For each family: train without it, and measure on all of its scenes, of every split.

    Args:
        folder: of the data set.
        train: trains a model on a data set without a family.
        families: that are left out, one after the other.
        seed: of the baselines.
    """
    found = []
    others = load_contacts(folder, "train")
    parts = [load_contacts(folder, split) for split in ("train", "validation", "test")]
    for family in families:
        model = train(folder, family)
        rest = others[others.family != family]
        test = joined([part[part.family == family] for part in parts])
        if not (test.feasible == 1).any():
            continue
        scorers = {LEARNED: model_scorer(model)} | {name: make(rest, seed) for name, make in BASELINES.items()}
        found += compared(test, family, scorers)
    return found


def hold_precision(folder: Path, model: ContactModel, split: str) -> dict[str, float]:
    """Of the part that orders hands and holds: area under its precision-recall curve, share of positives."""
    holds = load_holds(folder, split)
    p, _ = model.serves(holds.features)
    return {
        "manipulators": float(len(holds)),
        "positives": float(holds.serves.mean()),
        "precision": average_precision(holds.serves, p),
        "calibration": calibration_error(holds.serves.astype(float), p),
    }


def table(scores: Sequence[Score]) -> list[str]:
    """The scores as a Markdown table."""
    lines = [
        "| family | scorer | queries | top 1 | top 5 | checks to the first | PR-AUC | calibration error |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for s in scores:
        error = "" if s.calibration is None else f"{s.calibration:.3f}"
        cells = [s.family, s.scorer, str(s.queries), _shown(s.top_1), _shown(s.top_5), _shown(s.checks, 1)]
        lines.append("| " + " | ".join([*cells, _shown(s.precision, 3), error]) + " |")
    return lines


def _shown(value: tuple[float, float, float], digits: int = 2) -> str:
    mean, low, high = value
    return f"{mean:.{digits}f} ({low:.{digits}f}-{high:.{digits}f})"
