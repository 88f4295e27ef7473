"""How good a model is at ordering contacts: on the scenes of a split, or on a family that it was not trained on."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.learning.baselines import BASELINES, Scorer
from hmap_core.learning.examples import Contacts, joined, load_contacts, load_holds, thinned
from hmap_core.learning.metrics import average_precision, calibration_error, first_hits, intervals
from hmap_core.learning.network import ContactModel
from hmap_core.learning.schema import SPLITS

LEARNED = "learned"
TrainWithout = Callable[[str, Contacts, Contacts], Scorer]
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
    order = np.argsort(-score, kind="stable")
    hit, index = contacts.feasible[order].astype(float), index[order]
    drawn = []
    for _ in range(DRAWS):
        times = np.bincount(rng.integers(0, len(names), len(names)), minlength=len(names))[index]  # a row is drawn
        hits = times * hit
        precision = np.cumsum(hits) / np.maximum(np.cumsum(times), 1)
        drawn.append((precision * hits).sum() / hits.sum() if hits.any() else np.nan)
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
    folder: Path, train: TrainWithout, families: Sequence[str], seed: int = 0, kept: float = 1.0
) -> Iterator[list[Score]]:
    """For each family: train without it, and measure on all of its scenes, of every split.

    All scorers are trained on the same contacts, and all contacts of the family are measured.

    Args:
        folder: of the data set.
        train: makes a scorer from the contacts of the splits "train" and "validation" without a family, whose name it
            gets first.
        families: that are left out, one after the other; those without a feasible contact are skipped.
        seed: of the baselines, and of the contacts that are kept.
        kept: share of the contacts for training, as in :func:`hmap_core.learning.examples.thinned`.

    Yields:
        The scores on one family.
    """
    parts = {split: load_contacts(folder, split) for split in SPLITS}
    for family in families:
        test = joined([part[part.family == family] for part in parts.values()])
        if not (test.feasible == 1).any():
            continue
        rest, validation = (parts[split][parts[split].family != family] for split in ("train", "validation"))
        rest = thinned(rest, kept, seed)
        scorers = {LEARNED: train(family, rest, validation)}
        scorers |= {name: make(rest, seed) for name, make in BASELINES.items()}
        yield compared(test, family, scorers)


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
