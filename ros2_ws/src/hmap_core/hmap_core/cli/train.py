"""``hmap train``: trains the model that scores contacts."""

import argparse
from pathlib import Path

from hmap_core.cli.learning_extra import needs
from hmap_core.cli.main import positive
from hmap_core.cli.plan import check_writable
from hmap_core.cli.progress import ProgressLine

HELP = "train the model that scores contacts, on a data set of `hmap dataset make`"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("data", type=Path, nargs="+", metavar="DIR", help="the data sets")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the weights (.safetensors)")
    parser.add_argument("--config", type=Path, metavar="TOML", help="settings (those of the shipped weights)")
    parser.add_argument("--without", nargs="+", metavar="FAMILY", help="families that are left out")
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint beside the weights")
    parser.add_argument("--time-limit", type=positive, metavar="SECONDS", help="end with the next epoch after it")


def run(arguments: argparse.Namespace) -> int:
    """Train; the exit code."""
    check_writable(arguments.out)
    needs("pyarrow", "torch")
    from dataclasses import replace

    from hmap_core.learning.training import DEFAULTS, TrainingConfig, train

    config = TrainingConfig.read(arguments.config or DEFAULTS)
    if arguments.without:
        config = replace(config, without=TrainingConfig.families_of(arguments.without))
    checkpoint = arguments.out.with_suffix(".checkpoint")
    if not arguments.resume:
        checkpoint.unlink(missing_ok=True)
    with ProgressLine() as line:
        line.show("loading", ", ".join(map(str, arguments.data)))
        trained = train(
            arguments.data, config,
            lambda name, epoch, of, loss: line.show(f"training {name}", f"epoch {epoch} of {of}, loss {loss:.4f}"),
            checkpoint, arguments.time_limit or float("inf"),
        )  # fmt: skip
    trained.save(arguments.out)
    print(f"weights         {arguments.out}")
    print(f"checks for 95 % {trained.model.checks}")
    return 0
