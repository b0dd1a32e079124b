"""What describes a data set: card, licence, RO-Crate 1.3, DataCite fields and a Croissant face, written by hand."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined

from validation.dataset.files import CHANNELS, CLOCKS

NAME = "Virtual piano action under a motor: force, encoders and film angles of eight kinds of stroke"
LICENCE = "https://creativecommons.org/licenses/by/4.0/"
DATE = "2026-11-22"
VERSION = "1"
AUTHOR = "piano-action-rig contributors"
ABOUT = {
    "README.md": "Data card: what, how, task, licence, known limits.",
    "LICENSE": "The licence.",
    "datacite.json": "DataCite fields.",
    "croissant.json": "Croissant description of the files.",
    "dataset.json": "Index: trials by split, window, rates, hashes of the truths.",
    "truth_open.json": "Truth of the open split: specimens, strokes, faults.",
}
KINDS = {
    ".nc": "application/x-netcdf", ".json": "application/json", ".md": "text/markdown", ".tif": "image/tiff",
    ".toml": "application/toml",
}  # fmt: skip
OF_KIND = {
    ".nc": "One stroke: force, command, encoders and film angles, netCDF-4.",
    ".tif": "Film of one stroke, a page a frame, lossless.",
    ".toml": "Outlines of the bodies on the film's first frames.",
}
CARD = Path(__file__).parent / "card.md.j2"
KEYWORDS = ["piano action", "multibody dynamics", "system identification", "benchmark"]


def descriptions(folder: Path, index: dict[str, Any]) -> dict[str, str]:
    """Texts by file name, for a folder whose trials and index are written."""
    data = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    texts = {
        "README.md": card(index),
        "LICENSE": f"Creative Commons Attribution 4.0 International, {LICENCE}\n",
        "datacite.json": json.dumps(datacite(), indent=1) + "\n",
        "croissant.json": json.dumps(croissant(folder, data), indent=1) + "\n",
    }
    files = {name: (folder / name).read_bytes() for name in data} | {n: t.encode() for n, t in texts.items()}
    texts["ro-crate-metadata.json"] = json.dumps(ro_crate(files), indent=1) + "\n"
    return texts


def ro_crate(files: dict[str, bytes]) -> dict[str, Any]:
    """RO-Crate 1.3 metadata of files by relative name."""
    parts: list[dict[str, Any]] = [
        {
            "@id": name,
            "@type": "File",
            "name": name,
            "description": ABOUT.get(name, OF_KIND.get(Path(name).suffix, "One file.")),
            "encodingFormat": KINDS.get(Path(name).suffix, "text/plain"),
            "contentSize": str(len(content)),
            "sha256": hashlib.sha256(content).hexdigest(),
        }
        for name, content in sorted(files.items())
    ]
    descriptor = {
        "@id": "ro-crate-metadata.json",
        "@type": "CreativeWork",
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.3"},
        "about": {"@id": "./"},
    }
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": NAME,
        "description": "Simulated strokes with known truth to test models of a piano action on; see README.md.",
        "datePublished": DATE,
        "version": VERSION,
        "keywords": ", ".join(KEYWORDS),
        "license": {"@id": LICENCE},
        "creator": {"@id": "#contributors"},
        "publisher": {"@id": "#contributors"},
        "hasPart": [{"@id": one["@id"]} for one in parts],
    }
    licence = {"@id": LICENCE, "@type": "CreativeWork", "name": "CC BY 4.0", "description": "Attribution 4.0"}
    author = {"@id": "#contributors", "@type": "Organization", "name": AUTHOR}
    return {"@context": "https://w3id.org/ro/crate/1.3/context", "@graph": [descriptor, root, licence, author, *parts]}


def datacite() -> dict[str, Any]:
    """Mandatory and recommended DataCite 4.5 fields; the DOI is given by the repository that publishes."""
    return {
        "types": {"resourceTypeGeneral": "Dataset", "resourceType": "simulated measurements"},
        "creators": [{"name": AUTHOR, "nameType": "Organizational"}],
        "titles": [{"title": NAME}],
        "publisher": {"name": AUTHOR},
        "publicationYear": DATE[:4],
        "subjects": [{"subject": word} for word in KEYWORDS],
        "dates": [{"date": DATE, "dateType": "Created"}],
        "language": "en",
        "version": VERSION,
        "rightsList": [{"rights": "Creative Commons Attribution 4.0 International", "rightsUri": LICENCE,
                        "rightsIdentifier": "CC-BY-4.0"}],
        "descriptions": [{"description": "Simulated strokes of a piano action with known truth.",
                          "descriptionType": "Abstract"}],
        "schemaVersion": "http://datacite.org/schema/kernel-4",
    }  # fmt: skip


def croissant(folder: Path, data: list[str]) -> dict[str, Any]:
    """Croissant 1.0 face: the files, with their hashes; their contents are netCDF, which it has no reader for."""
    return {
        "@context": {"@vocab": "https://schema.org/", "cr": "http://mlcommons.org/croissant/", "sc": "https://schema.org/",
                     "conformsTo": "http://purl.org/dc/terms/conformsTo"},
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": "virtual_piano_action",
        "description": NAME,
        "license": LICENCE,
        "version": VERSION,
        "datePublished": DATE,
        "creator": {"@type": "Organization", "name": AUTHOR},
        "distribution": [
            {"@type": "cr:FileObject", "@id": name, "name": name, "contentUrl": name,
             "encodingFormat": KINDS.get(Path(name).suffix, "text/plain"),
             "sha256": hashlib.sha256((folder / name).read_bytes()).hexdigest()}
            for name in data
        ],
    }  # fmt: skip


def card(index: dict[str, Any]) -> str:
    """The data card."""
    rows = [f"| `{name}` | – | s | {text} |" for name, text in CLOCKS.items()]
    rows += [f"| `{name}` | {clock} | {unit} | {text} |" for name, (clock, unit, text) in CHANNELS.items()]
    template = Environment(undefined=StrictUndefined, keep_trailing_newline=True).from_string(CARD.read_text("utf-8"))
    return template.render(
        name=NAME,
        licence=LICENCE,
        index=index,
        counts=", ".join(f"{split} {len(rows)}" for split, rows in index["trials"].items()),
        seals="\n".join(f"- {split}: `{value}`" for split, value in index["seal"].items()),
        variables="\n".join(rows),
    )
