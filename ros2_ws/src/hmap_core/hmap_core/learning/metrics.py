"""Measures of a scorer of contacts: precision and recall, the best of a query, calibration, number of checks."""

import math

import numpy as np

CONFIDENCE = 0.95
BINS = 15
NEWTON_STEPS = 100
PRIOR = 1.0  # weight, in rows, of no calibration at all


def average_precision(target: np.ndarray, score: np.ndarray) -> float:
    """Area under the precision-recall curve of scores (N,) for targets (N,) of 0 and 1; NaN without positives."""
    order = np.argsort(-score, kind="stable")
    hit = target[order].astype(float)
    if not hit.sum():
        return float("nan")
    precision = np.cumsum(hit) / np.arange(1, len(hit) + 1)
    return float((precision * hit).sum() / hit.sum())


def calibration_error(target: np.ndarray, p: np.ndarray) -> float:
    """Expected calibration error of probabilities (N,), in BINS bins of equal width."""
    bins = np.minimum((p * BINS).astype(int), BINS - 1)
    total = 0.0
    for k in range(BINS):
        own = bins == k
        if own.any():
            total += own.mean() * abs(float(target[own].mean()) - float(p[own].mean()))
    return total


def first_hits(query: np.ndarray, target: np.ndarray, score: np.ndarray) -> dict[int, int]:
    """For each query with a positive, how many of its contacts are checked in the order of the scores until one is."""
    order = np.lexsort((np.arange(len(score)), -score, query))
    found: dict[int, int] = {}
    starts = np.flatnonzero(np.diff(query[order], prepend=np.iinfo(np.int64).min))
    for begin, end in zip(starts, [*starts[1:], len(order)], strict=True):
        hits = np.flatnonzero(target[order[begin:end]])
        if len(hits):
            found[int(query[order[begin]])] = int(hits[0]) + 1
    return found


def conformal_checks(hits: np.ndarray, confidence: float = CONFIDENCE) -> int | None:
    """How many of the best contacts have to be checked so that one is feasible with a probability.

    Split conformal prediction: if queries are exchangeable, the number of checks of a new one is at most the
    ceil((n + 1) c)-th smallest of those (n,) of the calibration set with probability c (Vovk, Gammerman and Shafer,
    "Algorithmic Learning in a Random World", 2005). None: there are too few queries for that.
    """
    place = math.ceil((len(hits) + 1) * confidence)
    return int(np.sort(hits)[place - 1]) if 0 < place <= len(hits) else None


def platt(target: np.ndarray, p: np.ndarray, weight: np.ndarray | None = None) -> tuple[float, float]:
    """Slope and offset of the log-odds with which probabilities (N,) fit targets best (Platt, 1999)."""
    p = np.clip(p, 1e-6, 1.0 - 1e-6)
    rows = np.stack([np.log(p / (1.0 - p)), np.ones(len(p))], axis=1)
    w = np.ones(len(p)) if weight is None else weight
    theta, start = np.array([1.0, 0.0]), np.array([1.0, 0.0])
    for _ in range(NEWTON_STEPS):
        q = 0.5 + 0.5 * np.tanh(0.5 * rows @ theta)
        gradient = rows.T @ (w * (q - target)) + PRIOR * (theta - start)
        hessian = (rows * (w * q * (1.0 - q))[:, None]).T @ rows + PRIOR * np.eye(2)
        step = np.linalg.solve(hessian, gradient)
        theta = theta - step / max(1.0, float(np.abs(step).max()))  # a long step overshoots
        if np.abs(step).max() < 1e-8:
            break
    return float(theta[0]), float(theta[1])


def intervals(values: np.ndarray, rng: np.random.Generator, draws: int = 1000) -> tuple[float, float, float]:
    """Mean of values (N,) with a bootstrap interval of CONFIDENCE: mean, lower, upper."""
    if not len(values):
        return float("nan"), float("nan"), float("nan")
    means = values[rng.integers(0, len(values), (draws, len(values)))].mean(axis=1)
    low, high = np.quantile(means, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(values.mean()), float(low), float(high)
