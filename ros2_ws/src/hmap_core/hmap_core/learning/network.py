"""The model in plain numpy: a small network for contacts and one for manipulators, each with its calibration."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.learning import features, hold_features, weights

SHIPPED = Path(__file__).with_name("contacts.safetensors")
CLIP = 8.0  # of a standardised feature
ROWS = 16  # at once: more would wake the threads of BLAS, which takes longer than the product where cores are busy
CONTACT, HOLD = "contact", "hold"
OUTPUTS = {CONTACT: 3, HOLD: 2}
WIDTHS = {CONTACT: features.WIDTH, HOLD: hold_features.WIDTH}


@dataclass(frozen=True)
class Network:
    """A network of layers with rectifiers between them.

    Attributes:
        mean, scale: (F,) features are standardised by.
        layers: matrices (in, out) and biases (out,).
    """

    mean: np.ndarray
    scale: np.ndarray
    layers: tuple[tuple[np.ndarray, np.ndarray], ...]

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Outputs (K, O) for features (K, F), float32."""
        x = rows - self.mean
        x *= self.scale
        np.clip(x, -CLIP, CLIP, out=x)
        out = np.empty((len(x), self.layers[-1][1].size), np.float32)
        for k in range(0, len(x), ROWS):
            out[k : k + ROWS] = self._outputs(x[k : k + ROWS])
        return out

    def _outputs(self, x: np.ndarray) -> np.ndarray:
        for k, (matrix, bias) in enumerate(self.layers):
            x = x @ matrix
            x += bias
            if k < len(self.layers) - 1:
                np.maximum(x, 0.0, out=x)
        return x

    @staticmethod
    def of(tensors: Mapping[str, np.ndarray], name: str) -> "Network":
        """The network of that name among tensors.

        Raises:
            ValueError: they do not fit together.
        """
        count = sum(key.startswith(f"{name}.matrix_") for key in tensors)
        layers = tuple((tensors[f"{name}.matrix_{k}"], tensors[f"{name}.bias_{k}"]) for k in range(count))
        mean, scale = tensors[f"{name}.mean"], tensors[f"{name}.scale"]
        width = WIDTHS[name]
        if mean.shape != (width,) or scale.shape != (width,):
            raise ValueError(f"the network {name!r} is for {mean.size} features; this program has {width}")
        for matrix, bias in layers:
            if matrix.ndim != 2 or matrix.shape[0] != width or bias.shape != matrix.shape[1:]:
                raise ValueError(f"the layers of the network {name!r} do not fit together")
            width = matrix.shape[1]
        if not layers or width != OUTPUTS[name]:
            raise ValueError(f"the network {name!r} has {width} outputs instead of {OUTPUTS[name]}")
        return Network(mean, scale, layers)


def sigmoid(x: np.ndarray) -> np.ndarray:
    """1 / (1 + exp(-x))."""
    return 0.5 + 0.5 * np.tanh(0.5 * x)


def feasible(out: np.ndarray) -> np.ndarray:
    """Probability (K,) that contacts are feasible, from outputs (K, 3) of the network for contacts."""
    return sigmoid(out[:, 0]) * sigmoid(out[:, 1])


def calibrated(p: np.ndarray, slope: float, offset: float) -> np.ndarray:
    """Probabilities (K,) with a line through their log-odds, as of :func:`hmap_core.learning.metrics.platt`."""
    p = np.clip(p, 1e-6, 1.0 - 1e-6)
    return sigmoid(slope * np.log(p / (1.0 - p)) + offset)


@dataclass(frozen=True)
class ContactModel:
    """What was learned about contacts.

    Attributes:
        contact: scores contacts: outputs for "the rigid hand serves enough poses", "the arm does, if the hand does",
            and the share of the path.
        hold: scores manipulators: outputs for "some contact serves at least LITTLE poses", and the share of the path.
        calibration: slope and offset for the probabilities of both, by Platt's method.
        checks: how many of the best contacts have to be checked so that, where any is feasible, one of them is with
            probability 0.95 (split conformal prediction); None: not known.
        robots: models of robots that it has seen.
    """

    contact: Network
    hold: Network
    calibration: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    checks: int | None = None
    robots: frozenset[str] = frozenset()

    def feasible(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Calibrated probability (K,) that contacts are feasible, and the share (K,) of the path that they serve.

        Args:
            rows: (K, F) of :func:`hmap_core.learning.features.contact_features`.
        """
        out = self.contact(rows)
        return self._calibrated(CONTACT, feasible(out)), sigmoid(out[:, 2])

    def serves(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As :meth:`feasible`, for manipulators: that they serve more than a few poses, and how far.

        Args:
            rows: (K, F) of :func:`hmap_core.learning.hold_features.hold_features`.
        """
        out = self.hold(rows)
        return self._calibrated(HOLD, sigmoid(out[:, 0])), sigmoid(out[:, 1])

    def _calibrated(self, name: str, p: np.ndarray) -> np.ndarray:
        return calibrated(p, *self.calibration.get(name, (1.0, 0.0)))


def model_of(tensors: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> ContactModel:
    """The model of what a file holds.

    Raises:
        ValueError: it is for another program, or does not fit together.
        KeyError: something is missing.
    """
    calibration = {name: (float(a), float(b)) for name, (a, b) in about.get("calibration", {}).items()}
    checks = about.get("checks")
    return ContactModel(
        Network.of(tensors, CONTACT), Network.of(tensors, HOLD), calibration,
        None if checks is None else int(checks), frozenset(about.get("robots", ())),
    )  # fmt: skip


@lru_cache(maxsize=4)
def load_model(path: Path = SHIPPED) -> ContactModel:
    """Load a model, once for each file.

    Raises:
        InputError: the file is missing, damaged, or of another program.
    """
    tensors, about = weights.load(path)
    try:
        return model_of(tensors, about)
    except (ValueError, KeyError, TypeError) as error:
        reason = f"there is no {error}" if isinstance(error, KeyError) else str(error)
        raise InputError(f"the weights {path} are unusable: {reason}; {weights.REMEDY}") from error
