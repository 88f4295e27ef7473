"""Checks a data set: hashes, schema, and whether the rows agree with each other."""

from pathlib import Path

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.learning.card import CARD, CROISSANT
from hmap_core.learning.dataset import HASHES, RECIPE, TABLES
from hmap_core.learning.labels import NOT_EVALUATED, Stage
from hmap_core.learning.tables import columns, read, sha256, shards

CHECKED = ("scene", "query", "candidate", "family", "poses", "bound", "reach", "arm_evaluated", "stage", "stage_name")


def check(folder: Path) -> list[str]:
    """What is wrong with a data set; empty where nothing is.

    Raises:
        InputError: the folder is no data set at all.
    """
    if not (folder / HASHES).is_file():
        begun = (folder / RECIPE).is_file()
        raise InputError(f"{folder} has no {HASHES}: " + ("it is not finished; --resume" if begun else "no data set"))
    wrong = [f"{name} is missing" for name in (RECIPE, CARD, CROISSANT) if not (folder / name).is_file()]
    sums = [line.split("  ", 1) for line in (folder / HASHES).read_text(encoding="utf-8").splitlines() if line]
    named = {name for _, name in sums}
    present = {path.relative_to(folder).as_posix() for path in folder.glob("*/*.parquet")} - {
        path.relative_to(folder).as_posix() for path in folder.glob("chunks/*")
    }
    wrong += [f"{name} is not in {HASHES}" for name in sorted(present - named)]
    for digest, name in sums:
        path = folder / name
        if not path.is_file():
            wrong.append(f"{name} is missing")
        elif sha256(path) != digest:
            wrong.append(f"{name} has another SHA-256 than {HASHES} says: it is truncated or changed")
    if wrong:
        return wrong
    for name in sorted(named):
        own = read(folder / name).schema
        if not own.equals(TABLES[name.split("/")[0]]):
            wrong.append(f"{name} has another schema")
    return wrong or _rows(folder)


def _rows(folder: Path) -> list[str]:
    """What is wrong with the rows."""
    wrong: list[str] = []
    scenes = columns(shards(folder, "scenes"), ("scene", "split", "contacts"))
    split_of = dict(zip(scenes["scene"].tolist(), scenes["split"].tolist(), strict=True))
    counted = 0
    names = [stage.name.lower() for stage in Stage]
    for path in shards(folder, "contacts"):
        split = path.name.split("-")[0]
        rows = columns([path], CHECKED)
        counted += len(rows["scene"])
        where = path.relative_to(folder).as_posix()
        if any(split_of.get(scene) != split for scene in np.unique(rows["scene"]).tolist()):
            wrong.append(f"{where}: a scene is in another split than in the table of scenes")
        stage = rows["stage"]
        if not np.isin(stage, [int(s) for s in Stage]).all():
            wrong.append(f"{where}: unknown stages")
        elif not np.array_equal(np.array(names)[stage], rows["stage_name"].astype(str)):
            wrong.append(f"{where}: stage and stage_name differ")
        checks = {
            "bound beyond the path": rows["bound"] > rows["poses"],
            "the arm serves more than the rigid hand": rows["reach"] > rows["bound"],
            "a hand that collides serves": (stage == Stage.HAND_COLLIDES) != (rows["bound"] < 0),
            "a feasible contact without reach": (stage >= Stage.FEASIBLE) & (rows["reach"] == NOT_EVALUATED),
            "an arm that was not evaluated": ~rows["arm_evaluated"] & (stage != Stage.HAND_SERVES),
        }
        wrong += [f"{where}: {int(bad.sum())} rows: {text}" for text, bad in checks.items() if bad.any()]
        features = columns([path], ("features",))["features"]
        if not np.isfinite(features).all():
            wrong.append(f"{where}: features that are not finite")
        keys = np.stack([rows[name].astype(np.int64) for name in ("scene", "query", "candidate")], axis=1)
        if len(np.unique(keys, axis=0)) != len(keys):
            wrong.append(f"{where}: contacts that are there twice")
    if counted != int(scenes["contacts"].sum()):
        wrong.append(f"{counted} contacts, but the scenes count {int(scenes['contacts'].sum())}")
    return wrong
