"""Rows as Arrow tables, and files of the data set: written, read, hashed."""

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hmap_core.exceptions import InputError

COMPRESSION = "zstd"
LEVEL = 9
ROW_GROUP = 20_000  # rows


def table(schema: pa.Schema, rows: Sequence[dict[str, Any]]) -> pa.Table:
    """Rows as a table; fixed-size lists go through numpy, which is far faster than through Python lists."""
    columns = []
    for field in schema:
        values = [row[field.name] for row in rows]
        if pa.types.is_fixed_size_list(field.type):
            flat = np.array(values, np.float32).reshape(-1)
            columns.append(pa.FixedSizeListArray.from_arrays(pa.array(flat, pa.float32()), field.type.list_size))
        else:
            columns.append(pa.array(values, field.type))
    return pa.Table.from_arrays(columns, schema=schema)


def write(path: Path, tables: Iterable[pa.Table], schema: pa.Schema) -> None:
    """Write tables to one Parquet file; it appears under its name only once it is complete."""
    part = path.with_suffix(".part")
    with pq.ParquetWriter(part, schema, compression=COMPRESSION, compression_level=LEVEL) as writer:
        for each in tables:
            writer.write_table(each, row_group_size=ROW_GROUP)
    part.replace(path)


def read(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """Read a Parquet file.

    Raises:
        InputError: it is missing, truncated, or no Parquet file, or a column is missing.
    """
    try:
        return pq.read_table(path, columns=list(columns) if columns is not None else None)
    except FileNotFoundError as error:
        raise InputError(f"{path} is missing; `hmap dataset make --resume` makes it again") from error
    except (pa.ArrowException, OSError) as error:
        text = str(error).splitlines()[0]
        raise InputError(
            f"{path} is truncated or no Parquet file ({text}); `hmap dataset check` names all such files"
        ) from error


def shards(folder: Path, kind: str, split: str | None = None) -> list[Path]:
    """The shards of a table, in their order.

    Args:
        folder: of the data set.
        kind: ``contacts``, ``queries`` or ``scenes``.
        split: of contacts and queries; None: all.

    Raises:
        InputError: there are none.
    """
    found = sorted((folder / kind).glob(f"{split or '*'}-*.parquet"))
    if not found:
        raise InputError(
            f"{folder} has no {kind} of the split {split or 'any'}; `hmap dataset make --out {folder}` makes them"
        )
    return found


def columns(paths: Sequence[Path], names: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns of some shards as arrays; fixed-size lists as rows (N, k).

    Raises:
        InputError: as :func:`read`, or a file lacks a column.
    """
    parts = [read(path, names) for path in paths]
    for path, part in zip(paths, parts, strict=True):
        missing = set(names) - set(part.column_names)
        if missing:
            raise InputError(f"{path} has no column {', '.join(sorted(missing))}: it is of another schema")
    whole = pa.concat_tables(parts)
    found = {}
    for name in names:
        column = whole.column(name).combine_chunks()
        if pa.types.is_fixed_size_list(column.type):
            found[name] = column.flatten().to_numpy().reshape(-1, column.type.list_size)
        else:
            found[name] = column.to_numpy(zero_copy_only=False)
    return found


def sha256(path: Path) -> str:
    """The SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
