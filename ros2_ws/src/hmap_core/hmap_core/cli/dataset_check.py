"""``hmap dataset check``: whether a data set is complete, unchanged and consistent."""

import argparse
from pathlib import Path

from hmap_core.cli.learning_extra import needs

HELP = "check the hashes, the schema and the rows of a data set, and count its labels"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="of the data set")


def run(arguments: argparse.Namespace) -> int:
    """Check it; exit code 1 where something is wrong."""
    needs("pyarrow")
    from hmap_core.learning.counts import counts, markdown
    from hmap_core.learning.dataset_check import check
    from hmap_core.learning.tables import shards

    wrong = check(arguments.folder)
    for text in wrong:
        print(text)
    if not wrong:
        print(*markdown(counts(shards(arguments.folder, "contacts"))), sep="\n")
    return 1 if wrong else 0
