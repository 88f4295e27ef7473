"""Weights of a model in the safetensors format, read and written with numpy alone: nothing in a file is ever executed.

https://huggingface.co/docs/safetensors: eight bytes with the length of a JSON header, the header, the numbers.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hmap_core.exceptions import InputError

FORMAT = "hmap-contact-model"
VERSION = 1
MAX_HEADER = 2**20  # bytes
MAX_FILE = 64 * 2**20  # bytes
REMEDY = "`hmap train` writes files of this kind; `--proposer learned` uses those that are shipped"


def save(path: Path, tensors: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> None:
    """Write tensors (float32) and what is known about them; the same content gives the same bytes."""
    header: dict[str, Any] = {}
    parts, at = [], 0
    for name in sorted(tensors):
        data = np.ascontiguousarray(tensors[name], "<f4").tobytes()
        shape = list(tensors[name].shape)
        header[name] = {"dtype": "F32", "shape": shape, "data_offsets": [at, at + len(data)]}
        parts.append(data)
        at += len(data)
    body = b"".join(parts)
    known = dict(about) | {"format": FORMAT, "version": VERSION, "sha256": _digest(header, body)}
    header["__metadata__"] = {"hmap": json.dumps(known, sort_keys=True)}
    text = json.dumps(header, sort_keys=True).encode()
    text += b" " * (-len(text) % 8)
    part = path.with_suffix(path.suffix + ".part")
    part.write_bytes(len(text).to_bytes(8, "little") + text + body)
    part.replace(path)


def load(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Read tensors, and what is known about them.

    Raises:
        InputError: the file is missing, truncated, of another format or version, or was changed.
    """
    try:
        if path.stat().st_size > MAX_FILE:
            raise InputError(f"the weights {path} have more than {MAX_FILE >> 20} MB; {REMEDY}")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"the weights {path} cannot be read: {error.strerror or error}; {REMEDY}") from error
    try:
        return _parsed(content)
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        reason = f"it has no {error}" if isinstance(error, KeyError) else str(error).splitlines()[0]
        raise InputError(f"the weights {path} are unusable: {reason}; {REMEDY}") from error


def _parsed(content: bytes) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    length = int.from_bytes(content[:8], "little")
    if len(content) < 8 or not 0 < length <= min(MAX_HEADER, len(content) - 8):
        raise ValueError("it is truncated, or no safetensors file")
    header = json.loads(content[8 : 8 + length])
    about = json.loads(header.pop("__metadata__")["hmap"])
    body = content[8 + length :]
    if about["format"] != FORMAT:
        raise ValueError(f"its format is {about['format']!r} instead of {FORMAT!r}")
    if about["version"] != VERSION:
        raise ValueError(f"its version is {about['version']!r}; this program reads {VERSION}")
    if about["sha256"] != _digest(header, body):
        raise ValueError("its content has another SHA-256 than it says: it is truncated or changed")
    return {name: _tensor(name, entry, body) for name, entry in header.items()}, about


def _tensor(name: str, entry: Mapping[str, Any], body: bytes) -> np.ndarray:
    begin, end = entry["data_offsets"]
    shape = tuple(int(n) for n in entry["shape"])
    if entry["dtype"] != "F32" or not 0 <= begin <= end <= len(body) or end - begin != 4 * int(np.prod(shape)):
        raise ValueError(f"tensor {name!r} does not fit its data")
    values = np.frombuffer(body, "<f4", (end - begin) // 4, begin).reshape(shape).astype(np.float32)
    if not np.isfinite(values).all():
        raise ValueError(f"tensor {name!r} has numbers that are not finite")
    return values


def _digest(header: Mapping[str, Any], body: bytes) -> str:
    tensors = {name: entry for name, entry in header.items() if name != "__metadata__"}
    return hashlib.sha256(json.dumps(tensors, sort_keys=True).encode() + body).hexdigest()
