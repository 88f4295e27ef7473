"""``hmap bench komo``: hmap's KOMO and RAI's on the same instances, with the same judge."""

import argparse
import json
import sys
from pathlib import Path

from hmap_core.cli.main import count
from hmap_core.exceptions import InputError

HELP = "measure the optimiser against its peer, RAI's KOMO"
INSTANCES = 50
SHOWN = 5  # number of false accepts that are described for each solver


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the measurement."""
    parser.add_argument("--problems", nargs="+", default=[], metavar="NAME", help="only these problems (all)")
    parser.add_argument("--instances", type=count, default=INSTANCES, metavar="N", help=f"of each ({INSTANCES})")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file, too")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the times into this picture")
    parser.add_argument(
        "--scaling", type=Path, metavar="FILE", help="instead, draw how our time grows with steps, bodies and joints"
    )
    parser.add_argument("--verbose", action="store_true", help="say what is wrong with false accepts")


def run(arguments: argparse.Namespace) -> int:
    """Run the measurement.

    Returns:
        The exit code.

    Raises:
        InputError: a file cannot be written, a problem is unknown, or RAI is missing.
    """
    for file in (arguments.json, arguments.plot, arguments.scaling):
        if file is not None and not file.resolve().parent.is_dir():
            raise InputError(f"'{file}': there is no folder {file.resolve().parent}")
    from hmap_core.benchmark import measure  # before the numerical libraries are loaded

    measure.one_thread()
    if arguments.scaling is not None:
        return _scaling(arguments.scaling, arguments.json)
    from hmap_core.benchmark import registry, report
    from hmap_core.benchmark.rai_side import robotic

    problems = registry.find(arguments.problems)
    robotic()  # raises at once if it is missing
    results = {}
    print(*report.heading(), sep="\n", flush=True)
    for name, problem in problems.items():
        results[name] = measure.run(problem, arguments.instances, _progress(name, arguments.instances))
        print(report.row(name, results[name]), flush=True)
        if arguments.verbose:
            _describe(results[name])
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(report.to_dict(results), indent=2) + "\n", encoding="utf-8")
    if arguments.plot is not None:
        report.plot(results, arguments.plot)
    return 0


def _scaling(picture: Path, file: Path | None) -> int:
    from hmap_core.benchmark import scaling

    data = scaling.run(progress=_say)
    scaling.draw(data, picture)
    for axis in ("steps", "obstacles", "joints"):
        for label, time, claimed in zip(*(data[axis][key] for key in ("labels", "median_ms", "claimed")), strict=True):
            print(f"{axis:<10}{label:>20}{time:>10.2f} ms{claimed:>5} of {data['instances']}")
    if file is not None:
        file.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
    return 0


def _say(text: str) -> None:
    if sys.stderr.isatty():
        print(text, file=sys.stderr)


def _progress(name: str, n: int):
    def show(k: int) -> None:
        if sys.stderr.isatty():
            print(f"\r{name} {k} of {n} " if k < n else "\r" + " " * (len(name) + 20) + "\r", end="", file=sys.stderr)

    return show


def _describe(result) -> None:
    for side in ("hmap", "rai", "ompl"):
        tally = getattr(result, side)
        for seed, wrong in tally.false_accepts[:SHOWN] if tally is not None else ():
            print(f"  {side}, seed {seed}: {'; '.join(wrong)}")
