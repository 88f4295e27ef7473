"""``hmap evaluate-proposer``: how well a model orders contacts, beside baselines."""

import argparse
import json
from pathlib import Path

from hmap_core.cli.learning_extra import needs
from hmap_core.cli.main import seed_argument
from hmap_core.cli.plan import check_writable
from hmap_core.cli.progress import ProgressLine

HELP = "measure how well a model orders contacts, against the sampler and other baselines"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("data", type=Path, metavar="DIR", help="the data set")
    parser.add_argument("--weights", metavar="FILE", help="of the model (the shipped ones)")
    parser.add_argument("--split", default="test", metavar="NAME", help="train, validation or test (test)")
    text = "train without each family in turn, and measure on it"
    parser.add_argument("--leave-one-out", nargs="*", metavar="FAMILY", help=f"{text}; without names: all families")
    parser.add_argument("--config", type=Path, metavar="TOML", help="settings of these trainings")
    seed_argument(parser)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file, too")


def run(arguments: argparse.Namespace) -> int:
    """Measure; the exit code."""
    if arguments.json is not None:
        check_writable(arguments.json)
    needs("pyarrow", "torch", "lightgbm")
    from hmap_core.learning import evaluation
    from hmap_core.learning.examples import check_split
    from hmap_core.learning.network import SHIPPED, load_model

    results: dict = {}
    with ProgressLine() as line:
        if arguments.leave_one_out is None:
            model = load_model(Path(arguments.weights) if arguments.weights else SHIPPED)
            line.show("measuring", arguments.split)
            scores = evaluation.evaluate(arguments.data, model, check_split(arguments.split), arguments.seed)
            results["manipulators"] = evaluation.hold_precision(arguments.data, model, arguments.split)
        else:
            scores = _left_out(arguments, line)
    print(*evaluation.table(scores), sep="\n")
    if "manipulators" in results:
        print(*(f"{name:<16}{value:.3f}" for name, value in results["manipulators"].items()), sep="\n")
    _write(arguments.json, {"contacts": [score.to_dict() for score in scores]} | results)
    return 0


def _left_out(arguments: argparse.Namespace, line: ProgressLine) -> list:
    """The scores of all trainings without one family."""
    from dataclasses import replace

    from hmap_core.learning import evaluation
    from hmap_core.learning.families import FAMILIES
    from hmap_core.learning.training import DEFAULTS, TrainingConfig, contact_scorer

    config = replace(TrainingConfig.read(arguments.config or DEFAULTS), seed=arguments.seed)
    families = TrainingConfig.families_of(arguments.leave_one_out) or FAMILIES

    def trained(family, train, validation):
        text = f"training without {family}"
        own = replace(config, without=(family,))
        return contact_scorer(
            train, validation, own, lambda name, epoch, of, loss: line.show(text, f"epoch {epoch} of {of}")
        )

    found = []
    for scores in evaluation.leave_one_out(arguments.data, trained, families, arguments.seed, config.kept):
        found += scores
        _write(arguments.json, {"contacts": [score.to_dict() for score in found]})
    return found


def _write(path: Path | None, results: dict) -> None:
    if path is not None:
        path.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
