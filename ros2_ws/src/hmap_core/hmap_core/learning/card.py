"""The data card (README.md, with the header that `datasets` reads) and the Croissant file of a data set."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from hmap_core.learning import schema
from hmap_core.learning.counts import counts, markdown
from hmap_core.learning.tables import sha256

NAME = "hmap-contacts"
LICENSE = "https://creativecommons.org/licenses/by/4.0/"
CROISSANT = "croissant.json"
CARD = "README.md"
SUMMARY = (
    "Contacts of robot hands and held tools on objects, each labelled by how far it serves the object's path: "
    "negatives and positives, in generated scenes."
)
BIASES = (
    "All scenes are generated; geometry is known exactly, and all shapes are convex or made of convex parts.",
    "Labels are those of hmap's own checks: a contact that hmap rejects might work with another planner.",
    "The arm is evaluated for some contacts of a query only, drawn uniformly among those that the rigid hand serves "
    "(`arm_evaluated`); the others end at `hand_serves`.",
    "Motions are planned for at most two contacts of a scene, of bare hands only, and executed in every fifth scene.",
    "Half of the contacts of a query are the first of hmap's sampler (`source` = `ranked`), the others are uniform "
    "among what it generates: antipodal grasps and stable pushes, not arbitrary poses.",
    "Families with tools have many more queries, so they dominate the counts; weigh by query or by family.",
    "Arms: Panda, xArm 6, UR5e with 2F-85; two arms are always Pandas. Other hands are not covered.",
    "Where a scene has several bodies that may be removed, contacts are labelled with them in place.",
)


def write(folder: Path, command: str, files: Sequence[Path]) -> None:
    """Write both.

    Args:
        folder: of the data set.
        command: makes it.
        files: its shards.
    """
    own = [path for path in files if path.parent.name == "contacts"]
    (folder / CARD).write_text("\n".join(_card(command, own)) + "\n", encoding="utf-8")
    document = _croissant(folder, files)
    (folder / CROISSANT).write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


def _card(command: str, shards: Sequence[Path]) -> list[str]:
    found = counts(shards)
    splits = sorted({path.name.split("-")[0] for path in shards}, key=schema.SPLITS.index)
    lines = ["---", "license: cc-by-4.0", f"pretty_name: {NAME}", "tags: [robotics, manipulation, contact]", "configs:"]
    for config in ("contacts", "queries"):
        lines += [f"- config_name: {config}", *(["  default: true"] if config == "contacts" else []), "  data_files:"]
        for split in splits:
            lines += [f"  - split: {split}", f'    path: "{config}/{split}-*.parquet"']
    lines += ["- config_name: scenes", '  data_files: "scenes/*.parquet"', "---", "", f"# {NAME}", "", SUMMARY, ""]
    lines += ["Licence: [CC BY 4.0](" + LICENSE + ").", "", "Made by", "", "```sh", command, "```", "", "## Load", ""]
    lines += ["```python", "import pandas", "from datasets import load_dataset", ""]
    lines += ['contacts = load_dataset("DIR", "contacts")', 'frame = pandas.read_parquet("DIR/contacts")', "```", ""]
    lines += ["## Counts", "", *markdown(found), "", "| split | contacts |", "|---|---:|"]
    lines += [f"| {split} | {found['split'][split]:,} |" for split in splits]
    lines += [
        "",
        "Scenes are split by a hash of family and seed: no scene is in two splits. For a family-level split",
        "",
    ]
    lines += ["take all rows of one `family` as test set.", "", "## Schema", ""]
    for kind, columns in (("contacts", schema.CONTACTS), ("queries", schema.QUERIES), ("scenes", schema.SCENES)):
        lines += [f"### {kind}", "", "| column | type | meaning |", "|---|---|---|"]
        lines += [f"| `{f.name}` | {f.type} | {schema.DESCRIPTIONS[f.name]} |" for f in columns]
        lines.append("")
    return [*lines, "## Known biases", "", *(f"- {bias}" for bias in BIASES)]


def _croissant(folder: Path, files: Sequence[Path]) -> dict[str, Any]:
    """The Croissant 1.0 document."""
    distribution: list[dict[str, Any]] = [
        {
            "@type": "cr:FileObject",
            "@id": path.relative_to(folder).as_posix(),
            "name": path.relative_to(folder).as_posix(),
            "contentUrl": path.relative_to(folder).as_posix(),
            "encodingFormat": "application/x-parquet",
            "sha256": sha256(path),
        }
        for path in files
    ]
    sets = []
    for kind, columns in (("contacts", schema.CONTACTS), ("queries", schema.QUERIES), ("scenes", schema.SCENES)):
        own = [path.relative_to(folder).as_posix() for path in files if path.parent.name == kind]
        if own:
            sets.append(_record_set(kind, columns, own[0]))
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "name": NAME,
        "description": SUMMARY,
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "license": LICENSE,
        "url": "https://github.com/hmap/hmap",
        "version": f"{schema.VERSION}.0.0",
        "datePublished": "2026-11-30",
        "creator": {"@type": "sc:Organization", "name": "The hmap authors"},
        "citeAs": "The hmap authors: hmap-contacts",
        "distribution": distribution,
        "recordSet": sets,
    }


def _record_set(kind: str, columns: pa.Schema, file: str) -> dict[str, Any]:
    """The columns of a table, as its first shard has them; the other shards have the same."""
    fields = []
    for field in columns:
        own: dict[str, Any] = {
            "@type": "cr:Field",
            "@id": f"{kind}/{field.name}",
            "name": f"{kind}/{field.name}",
            "description": schema.DESCRIPTIONS[field.name],
            "dataType": _data_type(field.type),
            "source": {"fileObject": {"@id": file}, "extract": {"column": field.name}},
        }
        if pa.types.is_list(field.type) or pa.types.is_fixed_size_list(field.type):
            own["repeated"] = True
        fields.append(own)
    return {"@type": "cr:RecordSet", "@id": kind, "name": kind, "field": fields}


def _data_type(kind: pa.DataType) -> str:
    if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_floating(kind):
        return "sc:Float"
    if pa.types.is_boolean(kind):
        return "sc:Boolean"
    return "sc:Integer" if pa.types.is_integer(kind) else "sc:Text"


_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
