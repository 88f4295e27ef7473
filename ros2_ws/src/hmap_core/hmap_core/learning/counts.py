"""How many contacts of which stage, family and split a data set has."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import pyarrow.parquet as pq

from hmap_core.learning.labels import Stage

COLUMNS = ("family", "stage_name", "with_tool", "kind")


def counts(paths: Sequence[Path]) -> dict[str, Counter]:
    """Counts of the shards of contacts: by family, by stage name, by both, by kind, by split."""
    found: dict[str, Counter] = {name: Counter() for name in ("family", "stage", "both", "kind", "split")}
    for path in paths:
        part = pq.read_table(path, columns=list(COLUMNS))
        families, stages = part.column("family").to_pylist(), part.column("stage_name").to_pylist()
        found["family"].update(families)
        found["stage"].update(stages)
        found["both"].update(zip(families, stages, strict=True))
        found["kind"].update(part.column("kind").to_pylist())
        found["split"][path.name.split("-")[0]] += len(families)
    return found


def markdown(found: dict[str, Counter]) -> list[str]:
    """The counts as a table: a row a stage, a column a family."""
    families = sorted(found["family"])
    lines = ["| stage | " + " | ".join(families) + " | all |", "|---|" + "---:|" * (len(families) + 1)]
    for stage in Stage:
        name = stage.name.lower()
        numbers = [found["both"][family, name] for family in families]
        lines.append(f"| `{name}` | " + " | ".join(f"{n:,}" for n in [*numbers, sum(numbers)]) + " |")
    totals = [found["family"][family] for family in families]
    lines.append("| all | " + " | ".join(f"{n:,}" for n in [*totals, sum(totals)]) + " |")
    return lines
