"""Trains the model with torch, and writes its weights. Only ``hmap train`` imports this."""

import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from hmap_core.exceptions import InputError
from hmap_core.learning import weights
from hmap_core.learning.baselines import Scorer
from hmap_core.learning.examples import Contacts, Holds, family_weights, load_all, thinned
from hmap_core.learning.families import ARMS, FAMILIES
from hmap_core.learning.metrics import conformal_checks, first_hits, platt
from hmap_core.learning.network import (
    CLIP,
    CONTACT,
    HOLD,
    OUTPUTS,
    ContactModel,
    Network,
    calibrated,
    feasible,
    model_of,
    sigmoid,
)

DEFAULTS = Path(__file__).with_name("training.toml")
LEAST_SPREAD = 1e-3  # of a feature; smaller ones are not scaled up
OnEpoch = Callable[[str, int, int, float], None]  # network, epoch, of how many, loss


@dataclass(frozen=True)
class TrainingConfig:
    """How a model is trained; see ``training.toml``."""

    seed: int = 0
    hidden: tuple[int, ...] = (96, 64)
    hold_hidden: tuple[int, ...] = (128, 64)
    epochs: int = 20
    hold_epochs: int = 80
    batch: int = 2048
    hold_batch: int = 128
    rate: float = 0.002
    decay: float = 0.3
    hold_decay: float = 0.7
    kept: float = 1.0
    without: tuple[str, ...] = ()

    @staticmethod
    def read(path: Path = DEFAULTS) -> "TrainingConfig":
        """Read a file.

        Raises:
            InputError: it cannot be read, has an unknown key, or a wrong value.
        """
        try:
            data = tomllib.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(f"the configuration {path} cannot be read: {error.strerror}") from error
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise InputError(f"the configuration {path} is no TOML: {error}") from error
        known = {field.name: field.default for field in fields(TrainingConfig)}
        for key, value in data.items():
            if key not in known:
                raise InputError(f"{path}: unknown key {key!r}; there are {', '.join(known)}")
            data[key] = _value(path, key, value, known[key])
        data["without"] = TrainingConfig.families_of(data.get("without", ()))
        return TrainingConfig(**data)

    @staticmethod
    def families_of(names: Sequence[str]) -> tuple[str, ...]:
        """Names of families.

        Raises:
            InputError: a name is unknown.
        """
        unknown = set(names) - set(FAMILIES)
        if unknown:
            raise InputError(f"unknown family {sorted(unknown)[0]!r}; there are {', '.join(FAMILIES)}")
        return tuple(names)

    @property
    def families(self) -> tuple[str, ...]:
        """The families that are used."""
        return tuple(name for name in FAMILIES if name not in self.without)


def _value(path: Path, key: str, value: Any, like: Any) -> Any:
    """A value of the same kind as the default."""
    if isinstance(like, tuple):
        element = str if key == "without" else int
        good = isinstance(value, list) and all(isinstance(v, element) and not isinstance(v, bool) for v in value)
        if good and (element is str or (value and min(value) > 0)):
            return tuple(value)
        raise InputError(f"{path}: {key} is {value!r}; a list of {'names' if element is str else 'widths'} is needed")
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    least = 0 if key in ("seed", "decay", "hold_decay") else 1 if isinstance(like, int) else 1e-9
    if key == "kept" and number and value > 1:
        raise InputError(f"{path}: kept is {value!r}; a share of at most 1 is needed")
    if not number or value < least or (isinstance(like, int) and not isinstance(value, int)):
        raise InputError(f"{path}: {key} is {value!r}; a number of at least {least:g} is needed")
    return type(like)(value)


@dataclass(frozen=True)
class Trained:
    """A model with what is written beside it."""

    model: ContactModel
    tensors: dict[str, np.ndarray]
    about: dict[str, Any]

    def save(self, path: Path) -> None:
        """Write the weights."""
        weights.save(path, self.tensors, self.about)


def train(
    folders: Sequence[Path],
    config: TrainingConfig,
    on_epoch: OnEpoch | None = None,
    checkpoint: Path | None = None,
    time_limit: float = float("inf"),
) -> Trained:
    """Train both networks on the split "train", and calibrate them on the split "validation".

    Args:
        folders: of the data sets.
        config: how.
        on_epoch: called after every epoch.
        checkpoint: written after every epoch, and gone on from if it exists.
        time_limit: s of wall-clock time for both networks; then it ends with the next epoch.
    """
    _begin(config)
    contacts, holds = load_all(folders, "train", config.families)
    contacts = thinned(contacts, config.kept, config.seed)
    ends = time.monotonic() + time_limit
    state = _Checkpoint(checkpoint, config)
    report = on_epoch or (lambda *a: None)
    own = _fit_contacts(contacts, config, state, report, ends)
    held = _fit(
        HOLD, holds.features, _hold_loss(holds), family_weights(holds.family), config.hold_hidden, OUTPUTS[HOLD],
        config.hold_epochs, config.hold_batch, config.hold_decay, config, state, report,
        ends + 0.3 * min(time_limit, 1e6),
    )  # fmt: skip
    tensors = own | held
    about: dict[str, Any] = {"config": asdict(config), "robots": sorted(set(ARMS))}
    about |= calibrate(
        Network.of(tensors, CONTACT), Network.of(tensors, HOLD), *load_all(folders, "validation", config.families)
    )
    state.remove()
    return Trained(model_of(tensors, about), tensors, about)


def contact_scorer(train: Contacts, validation: Contacts, config: TrainingConfig, report: OnEpoch) -> Scorer:
    """Train the network for contacts alone; what gives the probability (N,) that contacts are feasible.

    Args:
        train: what it is trained on.
        validation: what it is calibrated on.
        config: how.
        report: called after every epoch.
    """
    _begin(config)
    network = Network.of(_fit_contacts(train, config, _Checkpoint(None, config), report, float("inf")), CONTACT)
    validation = validation[validation.known]
    line = platt(validation.feasible, feasible(network(validation.features)))
    return lambda contacts: calibrated(feasible(network(contacts.features)), *line)


def calibrate(contact: Network, hold: Network, contacts: Contacts, holds: Holds) -> dict[str, Any]:
    """Calibration and number of checks, on data that the networks were not trained on."""
    contacts = contacts[contacts.known]
    p = feasible(contact(contacts.features))
    held = sigmoid(hold(holds.features)[:, 0])
    hits = first_hits(contacts.query, contacts.feasible, p)
    return {
        "calibration": {CONTACT: platt(contacts.feasible, p), HOLD: platt(holds.serves.astype(float), held)},
        "checks": conformal_checks(np.array(list(hits.values()))),
    }


def _begin(config: TrainingConfig) -> None:
    """Make what torch does the same in every run."""
    torch.manual_seed(config.seed)
    torch.use_deterministic_algorithms(True)
    torch.set_num_threads(1)  # the networks are so small that threads only wait for each other


def _fit_contacts(
    contacts: Contacts, config: TrainingConfig, state: "_Checkpoint", report: OnEpoch, ends: float
) -> dict[str, np.ndarray]:
    """Train the network for contacts; its tensors."""
    return _fit(
        CONTACT, contacts.features, _contact_loss(contacts), family_weights(contacts.family), config.hidden,
        OUTPUTS[CONTACT], config.epochs, config.batch, config.decay, config, state, report, ends,
    )  # fmt: skip


def _contact_loss(contacts: Contacts) -> tuple[np.ndarray, Callable]:
    """Targets (N, 4) and the loss: hand, arm where it is known, share where the hand serves."""
    arm_known = contacts.hand & contacts.known
    targets = np.stack([contacts.hand, contacts.feasible == 1, arm_known, contacts.share], axis=1).astype(np.float32)
    bce = nn.functional.binary_cross_entropy_with_logits

    def loss(out: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        hand = bce(out[:, 0], y[:, 0], reduction="none")
        arm = y[:, 2] * bce(out[:, 1], y[:, 1], reduction="none")
        share = y[:, 0] * bce(out[:, 2], y[:, 3], reduction="none")
        return hand + arm + 0.3 * share

    return targets, loss


def _hold_loss(holds: Holds) -> tuple[np.ndarray, Callable]:
    """Targets (N, 2) and the loss: serves more than a few poses, and the share of the path."""
    targets = np.stack([holds.serves, holds.share], axis=1).astype(np.float32)
    bce = nn.functional.binary_cross_entropy_with_logits
    return targets, lambda out, y: bce(out, y, reduction="none").sum(dim=1)


def _fit(
    name: str, rows: np.ndarray, target: tuple[np.ndarray, Callable], weight: np.ndarray, hidden: tuple[int, ...],
    outputs: int, epochs: int, batch: int, decay: float, config: TrainingConfig, state: "_Checkpoint",
    report: OnEpoch, ends: float,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Train one network; its tensors."""
    if not len(rows):
        raise InputError(f"the data set has nothing to train the network {name!r} on")
    mean = rows.mean(axis=0, dtype=np.float64).astype(np.float32)
    scale = (1.0 / np.maximum(rows.std(axis=0, dtype=np.float64), LEAST_SPREAD)).astype(np.float32)
    x = torch.from_numpy(np.clip((rows - mean) * scale, -CLIP, CLIP))
    y, loss, w = torch.from_numpy(target[0]), target[1], torch.from_numpy(weight)
    widths = [rows.shape[1], *hidden, outputs]
    layers: list[nn.Module] = []
    for a, b in zip(widths, widths[1:], strict=False):
        layers += [nn.Linear(a, b), nn.ReLU()]
    net = nn.Sequential(*layers[:-1])
    optimiser = torch.optim.AdamW(net.parameters(), config.rate, weight_decay=decay)
    per_epoch = (len(x) + batch - 1) // batch
    cycle = torch.optim.lr_scheduler.OneCycleLR(optimiser, config.rate, total_steps=epochs * per_epoch)
    begun = state.restore(name, net, optimiser, cycle)
    for epoch in range(begun, epochs):
        order = torch.from_numpy(np.random.default_rng((config.seed, epoch)).permutation(len(x)))
        total = 0.0
        for part in order.split(batch):
            optimiser.zero_grad()
            value = (w[part] * loss(net(x[part]), y[part])).mean()
            value.backward()
            optimiser.step()
            cycle.step()
            total += value.item() * len(part)
        report(name, epoch + 1, epochs, total / len(x))
        state.save(name, epoch + 1, net, optimiser, cycle)
        if time.monotonic() > ends:
            break
    tensors = {f"{name}.mean": mean, f"{name}.scale": scale}
    linear = [layer for layer in net if isinstance(layer, nn.Linear)]
    for k, layer in enumerate(linear):
        tensors[f"{name}.matrix_{k}"] = layer.weight.detach().numpy().T.copy()
        tensors[f"{name}.bias_{k}"] = layer.bias.detach().numpy().copy()
    return tensors


class _Checkpoint:
    """The state of a training on the disk; tensors and plain data only, so that nothing is unpickled."""

    def __init__(self, path: Path | None, config: TrainingConfig):
        self._path, self._config = path, asdict(config)
        self._known: dict[str, Any] = {"config": self._config, "networks": {}}
        if path is None or not path.exists():
            return
        try:
            found = torch.load(path, weights_only=True)
            same = found["config"] == self._config
        except Exception as error:
            raise InputError(f"the checkpoint {path} is unusable: {error}; remove it to begin anew") from error
        if not same:
            raise InputError(f"the checkpoint {path} is of another configuration; remove it to begin anew")
        self._known = found

    def restore(self, name: str, *parts: Any) -> int:
        """Load the state of parts; the number of epochs that are done."""
        own = self._known["networks"].get(name)
        if own is None:
            return 0
        for part, kept in zip(parts, own["state"], strict=True):
            part.load_state_dict(kept)
        return int(own["epoch"])

    def save(self, name: str, epoch: int, *parts: Any) -> None:
        """Write the state of parts."""
        if self._path is None:
            return
        self._known["networks"][name] = {"epoch": epoch, "state": [part.state_dict() for part in parts]}
        part = self._path.with_suffix(".part")
        torch.save(self._known, part)
        part.replace(self._path)

    def remove(self) -> None:
        """Remove the file: the training is complete."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)
