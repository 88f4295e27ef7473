"""Intervals of shares and means, and permutation tests of two samples."""

from collections.abc import Sequence
from itertools import combinations, product
from math import comb

import numpy as np

Z95 = 1.959964  # of the normal distribution, two-sided
RESAMPLES = 4000  # of the bootstrap
SEED = 0  # of it, so that the same runs give the same interval
EXACT = 20_000  # permutations up to which all are tried; else as many random ones


def wilson(successes: int, n: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson, "Probable inference, the law of succession, ...", 1927)."""
    if n == 0:
        return 0.0, 1.0
    share, z2 = successes / n, Z95**2
    center = (share + z2 / (2 * n)) / (1 + z2 / n)
    half = Z95 / (1 + z2 / n) * np.sqrt(share * (1 - share) / n + z2 / (4 * n * n))
    return max(0.0, float(center - half)), min(1.0, float(center + half))


def mean_interval(values: Sequence[float]) -> tuple[float, float]:
    """The 95 % interval of a mean, by the percentile bootstrap (Efron and Tibshirani, 1993)."""
    sample, rng = np.asarray(values, float), np.random.default_rng(SEED)
    means = sample[rng.integers(0, len(sample), (RESAMPLES, len(sample)))].mean(axis=1)
    return float(np.percentile(means, 2.5)), float(np.percentile(means, 97.5))


def difference_interval(a: np.ndarray, b: np.ndarray, paired: bool) -> tuple[float, float]:
    """The 95 % interval of mean(b) - mean(a), by the bootstrap; of the pairs' differences where they are paired."""
    if paired:
        return mean_interval(b - a)
    rng = np.random.default_rng(SEED)
    means = [
        sample[rng.integers(0, len(sample), (RESAMPLES, len(sample)))].mean(axis=1) for sample in (np.asarray(a), b)
    ]
    low, high = np.percentile(means[1] - means[0], [2.5, 97.5])
    return float(low), float(high)


def smallest_p(n_a: int, n_b: int, paired: bool) -> float:
    """The smallest p that a two-sided permutation test of so many runs can give."""
    return 2.0 / (2.0**n_a if paired else comb(n_a + n_b, n_a))


def permutation_p(a: np.ndarray, b: np.ndarray, paired: bool) -> float:
    """The two-sided p of a difference of means, by permutation; of signs where the runs are paired.

    Source: Good, "Permutation, Parametric and Bootstrap Tests of Hypotheses", 2005.
    """
    seen = abs(float(b.mean() - a.mean()))
    rng = np.random.default_rng(SEED)
    if paired:
        d = b - a
        exact = 2 ** len(d) <= EXACT
        signs = np.array(list(product((-1, 1), repeat=len(d)))) if exact else rng.choice((-1, 1), (EXACT, len(d)))
        differences = np.abs((signs * d).mean(axis=1))
    else:
        both, n = np.concatenate([a, b]), len(a)
        exact = comb(len(both), n) <= EXACT
        chosen = (
            np.array(list(combinations(range(len(both)), n)))
            if exact
            else np.array([rng.permutation(len(both))[:n] for _ in range(EXACT)])
        )
        sums = both[chosen].sum(axis=1)
        differences = np.abs((both.sum() - sums) / len(b) - sums / n)
    extreme = int((differences >= seen * (1.0 - 1e-9) - 1e-15).sum())
    return extreme / len(differences) if exact else (extreme + 1) / (len(differences) + 1)
