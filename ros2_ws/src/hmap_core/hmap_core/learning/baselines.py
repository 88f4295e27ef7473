"""What the model is compared with: other ways to order the contacts of a query, trained on the same contacts."""

from collections.abc import Callable
from typing import Any

import numpy as np

from hmap_core.learning.examples import Contacts, family_weights
from hmap_core.learning.features import COMMON, OWN

HAND_MADE = COMMON + OWN  # leading features: all but the distances from what stands around
NEIGHBOURS = 16
NEIGHBOUR_ROWS = 8000  # of the training set that nearest neighbours are searched in
BLOCK = 512  # rows whose distances are computed at once
POSE = slice(COMMON, COMMON + 16)  # features that describe the pose of a contact in the axes of the scene
ROUNDS = 200  # of boosting
TREES: dict[str, Any] = {
    "objective": "binary",
    "num_leaves": 63,
    "learning_rate": 0.08,
    "verbosity": -1,
    "num_threads": 1,
    "deterministic": True,
    "force_row_wise": True,
}

Scorer = Callable[[Contacts], np.ndarray]  # scores (N,), larger is better


def uniform(train: Contacts, seed: int) -> Scorer:
    """Contacts in a random order."""
    return lambda contacts: np.random.default_rng(seed).random(len(contacts))


def sampler(train: Contacts, seed: int) -> Scorer:
    """The order of hmap's sampler; contacts that were drawn uniformly come last."""
    return lambda contacts: -np.where(contacts.rank < 0, 1e6, contacts.rank).astype(float)


def nearest_neighbour(train: Contacts, seed: int) -> Scorer:
    """The share of feasible ones among the NEIGHBOURS nearest contacts by hand-made features."""
    known = np.flatnonzero(train.known)
    chosen = np.sort(np.random.default_rng(seed).permutation(known)[:NEIGHBOUR_ROWS])
    rows, target = train.features[chosen, :HAND_MADE], train.feasible[chosen].astype(float)
    scale = 1.0 / np.maximum(rows.std(axis=0), 1e-3)
    rows = rows * scale
    square = (rows**2).sum(axis=1)

    def score(contacts: Contacts) -> np.ndarray:
        found = np.empty(len(contacts))
        for first in range(0, len(contacts), BLOCK):
            own = contacts.features[first : first + BLOCK, :HAND_MADE] * scale
            away = square - 2.0 * own @ rows.T
            nearest = np.argpartition(away, NEIGHBOURS, axis=1)[:, :NEIGHBOURS]
            found[first : first + BLOCK] = target[nearest].mean(axis=1)
        return found

    return score


def trees(train: Contacts, seed: int) -> Scorer:
    """Gradient-boosted trees (lightgbm) on hand-made features."""
    import lightgbm

    known = train[train.known]
    rows = lightgbm.Dataset(known.features[:, :HAND_MADE], known.feasible, weight=family_weights(known.family))
    booster = lightgbm.train(TREES | {"seed": seed}, rows, ROUNDS)
    return lambda contacts: np.asarray(booster.predict(contacts.features[:, :HAND_MADE]))


def paper(train: Contacts, seed: int) -> Scorer:
    """The paper's network: regresses one contact from the situation, trained on feasible ones only.

    Contacts are ordered by their distance from the regressed one. The situation and the pose are in the axes of the
    scene, which helps it: the paper's are in those of the world.
    """
    import torch

    good = train[train.feasible == 1]
    x, y = good.features[:, :COMMON], good.features[:, POSE]
    mean, scale = x.mean(axis=0), 1.0 / np.maximum(x.std(axis=0), 1e-3)
    torch.manual_seed(seed)
    net = torch.nn.Sequential(
        torch.nn.Linear(COMMON, 64), torch.nn.ReLU(), torch.nn.Linear(64, 64), torch.nn.ReLU(), torch.nn.Linear(64, 16)
    )
    optimiser = torch.optim.Adam(net.parameters(), 2e-3)
    inputs, targets = torch.from_numpy((x - mean) * scale), torch.from_numpy(np.ascontiguousarray(y))
    for _ in range(400):
        optimiser.zero_grad()
        torch.nn.functional.mse_loss(net(inputs), targets).backward()
        optimiser.step()

    def score(contacts: Contacts) -> np.ndarray:
        with torch.no_grad():
            ahead = net(torch.from_numpy((contacts.features[:, :COMMON] - mean) * scale)).numpy()
        return -np.linalg.norm(contacts.features[:, POSE] - ahead, axis=1)

    return score


BASELINES: dict[str, Callable[[Contacts, int], Scorer]] = {
    "sampler": sampler,
    "uniform": uniform,
    "nearest neighbour": nearest_neighbour,
    "trees (lightgbm)": trees,
    "paper's MLP": paper,
}
