"""Makes the data set: scenes in parallel, chunk by chunk, then shards, hashes, data card and Croissant file."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import pyarrow as pa

from hmap_core.evaluation.cluster import backend
from hmap_core.exceptions import InputError
from hmap_core.learning import card, schema
from hmap_core.learning.families import FAMILIES
from hmap_core.learning.rows import SceneRows, scene_rows
from hmap_core.learning.tables import read, sha256, table, write

CHUNK = 16  # scenes of a chunk, the unit of resuming
SHARD_BYTES = 100 * 2**20  # of a shard; the last of a split is smaller
RECIPE = "recipe.json"
HASHES = "SHA256SUMS"
TABLES = {"contacts": schema.CONTACTS, "queries": schema.QUERIES, "scenes": schema.SCENES}
OnChunk = Callable[[int, int, int], None]  # chunks done, of how many, contacts so far


@dataclass(frozen=True)
class Recipe:
    """What determines a data set.

    Attributes:
        scenes: how many scenes are drawn.
        seed: of all of them.
        families: they take turns.
        version: of the schema.
        relaxed: bodies that may be removed are left out, and so are scenes without such bodies.
    """

    scenes: int
    seed: int = 0
    families: tuple[str, ...] = FAMILIES
    version: int = schema.VERSION
    relaxed: bool = False

    @property
    def command(self) -> str:
        """The command that makes the data set."""
        chosen = "" if self.families == FAMILIES else " --families " + " ".join(self.families)
        relaxed = " --relaxed" if self.relaxed else ""
        return f"hmap dataset make --out DIR --scenes {self.scenes} --seed {self.seed}{chosen}{relaxed}"


def make(
    folder: Path, recipe: Recipe, jobs: int = 1, dask: str | None = None, resume: bool = False,
    on_chunk: OnChunk | None = None, shard_bytes: int = SHARD_BYTES,
) -> None:  # fmt: skip
    """Make a data set in a folder. The same recipe gives the same rows, whatever the number of jobs.

    Args:
        folder: where; made if it does not exist.
        recipe: what.
        jobs: processes.
        dask: address of a Dask scheduler whose workers do it; they write to the same folder.
        resume: keep the chunks that are in the folder already.
        on_chunk: called after each chunk.
        shard_bytes: size of a shard, roughly.

    Raises:
        InputError: the folder has something else in it, or a data set of another recipe.
    """
    from joblib import Parallel, delayed  # slow to import

    unknown = set(recipe.families) - set(FAMILIES)
    if unknown:
        raise InputError(f"unknown family {sorted(unknown)[0]!r}; there are {', '.join(FAMILIES)}")
    chunks = folder / "chunks"
    _prepare(folder, recipe, resume)
    numbers = range((recipe.scenes + CHUNK - 1) // CHUNK)
    todo = [k for k in numbers if not (chunks / f"scenes-{k:05d}.parquet").exists()]
    done, contacts = len(numbers) - len(todo), 0
    with backend(dask):
        parallel = Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
        for made in parallel(delayed(make_chunk)(chunks, recipe, k) for k in todo):
            done, contacts = done + 1, contacts + made
            if on_chunk:
                on_chunk(done, len(numbers), contacts)
    join(folder, recipe, shard_bytes)
    shutil.rmtree(chunks)


def _prepare(folder: Path, recipe: Recipe, resume: bool) -> None:
    """Make the folder, or check that what is in it is the same data set, begun."""
    path = folder / RECIPE
    if folder.exists() and any(folder.iterdir()):
        if not path.exists():
            raise InputError(f"{folder} is not empty, and has no {RECIPE}: choose an empty folder")
        if not resume:
            raise InputError(f"{folder} has a data set already; --resume goes on with it, or choose another folder")
        try:
            old = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise InputError(f"{path} is no JSON: {error}") from error
        if isinstance(old, dict):
            old = {"relaxed": False} | old  # recipes of before had no such choice
        if old != json.loads(json.dumps(asdict(recipe))):
            raise InputError(f"{folder} has another data set, of {old}; it goes on with the same options only")
        for left in folder.glob("chunks/*.part"):
            left.unlink()
    (folder / "chunks").mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(recipe), indent=2) + "\n", encoding="utf-8")


def make_chunk(chunks: Path, recipe: Recipe, k: int) -> int:
    """Make the scenes of a chunk, and write their rows; the number of contacts."""
    numbers = range(k * CHUNK, min((k + 1) * CHUNK, recipe.scenes))
    made = [scene_rows(number, recipe.seed, recipe.families, recipe.relaxed) for number in numbers]
    for split in schema.SPLITS:
        own = [rows for rows in made if rows.split == split]
        for kind, rows in (("contacts", _all(own, "contacts")), ("queries", _all(own, "queries"))):
            if rows:
                write(chunks / f"{kind}-{split}-{k:05d}.parquet", [table(TABLES[kind], rows)], TABLES[kind])
    # the last one, so that a chunk counts only once it is complete
    scenes = table(schema.SCENES, [rows.scene for rows in made])
    write(chunks / f"scenes-{k:05d}.parquet", [scenes], schema.SCENES)
    return sum(len(rows.contacts) for rows in made)


def _all(made: list[SceneRows], kind: str) -> list[dict]:
    return [row for rows in made for row in getattr(rows, kind)]


def join(folder: Path, recipe: Recipe, shard_bytes: int = SHARD_BYTES) -> None:
    """Join the chunks to shards, and write hashes, card and Croissant file."""
    chunks = folder / "chunks"
    for kind, columns in TABLES.items():
        (folder / kind).mkdir(exist_ok=True)
        for old in (folder / kind).glob("*.parquet"):
            old.unlink()
        for split in ("all",) if kind == "scenes" else schema.SPLITS:
            pattern = "scenes-*.parquet" if kind == "scenes" else f"{kind}-{split}-*.parquet"
            groups = list(_groups(sorted(chunks.glob(pattern)), shard_bytes))
            for number, group in enumerate(groups):
                path = folder / kind / f"{split}-{number:05d}-of-{len(groups):05d}.parquet"
                write(path, (_checked(part, columns) for part in group), columns)
    files = sorted(folder.glob("*/*-of-*.parquet"))
    lines = [f"{sha256(path)}  {path.relative_to(folder).as_posix()}" for path in files]
    (folder / HASHES).write_text("\n".join(lines) + "\n", encoding="utf-8")
    card.write(folder, recipe.command, files)


def _groups(parts: list[Path], size: int) -> Iterator[list[Path]]:
    """Successive files that are together about as large as a shard."""
    group: list[Path] = []
    total = 0
    for part in parts:
        group.append(part)
        total += part.stat().st_size
        if total >= size:
            yield group
            group, total = [], 0
    if group:
        yield group


def _checked(path: Path, columns: pa.Schema) -> pa.Table:
    return read(path).cast(columns)
