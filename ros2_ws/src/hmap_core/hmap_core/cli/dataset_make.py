"""``hmap dataset make``: labelled contacts in generated scenes, as Parquet shards."""

import argparse
from pathlib import Path

from hmap_core.cli.learning_extra import needs
from hmap_core.cli.main import count, seed_argument
from hmap_core.cli.progress import ProgressLine

HELP = "make a data set: scenes, contacts, and how far each contact gets"
LIBRARIES = ("pyarrow",)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="an empty folder, or one to go on with")
    parser.add_argument("--scenes", type=count, required=True, metavar="N", help="how many scenes are drawn")
    parser.add_argument("--families", nargs="+", default=(), metavar="NAME", help="of scenes (all); they take turns")
    text = "leave out what may be removed, and scenes without that: the relaxed problem of Algorithm 1"
    parser.add_argument("--relaxed", action="store_true", help=text)
    seed_argument(parser)
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--jobs", type=count, default=1, metavar="J", help="processes (1)")
    group.add_argument("--dask", metavar="ADDRESS", help="do it on the cluster of this Dask scheduler")
    parser.add_argument("--resume", action="store_true", help="go on with what is in the folder")
    parser.add_argument("--shard-mb", type=count, default=100, metavar="MB", help="size of a shard, roughly (100)")


def run(arguments: argparse.Namespace) -> int:
    """Make it; the exit code."""
    needs(*LIBRARIES)
    from hmap_core.learning import dataset
    from hmap_core.learning.families import FAMILIES

    recipe = dataset.Recipe(
        arguments.scenes, arguments.seed, tuple(arguments.families) or FAMILIES, relaxed=arguments.relaxed
    )
    with ProgressLine() as line:
        dataset.make(
            arguments.out, recipe, arguments.jobs, arguments.dask, arguments.resume,
            lambda done, of, made: line.show("making", f"chunk {done} of {of}, {made:,} new contacts"),
            arguments.shard_mb * 2**20,
        )  # fmt: skip
    print(f"data set        {arguments.out}")
    return 0
