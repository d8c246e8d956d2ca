"""Is the dataset what its markers say? Every file is read, hashed and counted."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.tables.manifest import MANIFEST, read_dataset, read_markers
from mmw.tables.parquet import arrow_schema
from mmw.tables.schemas import TABLES
from mmw.tables.writer import MARKERS


@dataclass(frozen=True)
class Finding:
    """Something that is not as it should be."""

    kind: str
    """missing, size, sha256, rows, schema, config, marker, manifest: the data is not whole. orphan, temporary: a killed
    run's leftovers, harmless, replaced when it is run again."""
    path: str
    """File, relative to the dataset folder."""
    text: str

    @property
    def is_error(self) -> bool:
        """True if data is missing or damaged; False for leftovers."""
        return self.kind not in ("orphan", "temporary")


def verify(root: Path) -> list[Finding]:
    """Return everything that is wrong with a dataset; an empty list means that every file is as its marker says.

    Raises:
        ValueError: If the folder is not a dataset.
    """
    root = Path(root)
    sha256 = read_dataset(root)["config_sha256"]
    findings: list[Finding] = []
    markers = read_markers(root)
    marker_files = sorted((root / MARKERS).glob("*.json"))
    if len(markers) != len(marker_files):
        findings.append(Finding("marker", MARKERS, f"{len(marker_files) - len(markers)} markers cannot be read"))
    listed: dict[str, dict] = {}
    for marker in markers:
        for file in marker["files"]:
            listed[file["path"]] = file
            if marker["config_sha256"] != sha256:
                findings.append(
                    Finding("config", file["path"], f"made by configuration {marker['config_sha256'][:12]}")
                )
            findings += _check_file(root, file)
    for name in TABLES:
        for path in sorted((root / name).rglob("*.parquet")):
            relative = path.relative_to(root).as_posix()
            if relative not in listed:
                findings.append(Finding("orphan", relative, "no marker lists the file; its shard was not finished"))
    for path in sorted(root.rglob(".*.tmp")):
        findings.append(Finding("temporary", path.relative_to(root).as_posix(), "left by a killed run"))
    if (root / MANIFEST).is_file():
        manifest = pq.read_table(root / MANIFEST, columns=["path", "sha256"]).to_pylist()
        if {row["path"]: row["sha256"] for row in manifest} != {path: file["sha256"] for path, file in listed.items()}:
            findings.append(Finding("manifest", MANIFEST, "does not list what the markers list; run finalize again"))
    return findings


def _check_file(root: Path, file: dict) -> list[Finding]:
    path = root / file["path"]
    if not path.is_file():
        return [Finding("missing", file["path"], "the marker lists it, but it is not there")]
    data = path.read_bytes()
    if len(data) != file["bytes"]:
        return [Finding("size", file["path"], f"{len(data)} bytes; the marker says {file['bytes']}")]
    if hashlib.sha256(data).hexdigest() != file["sha256"]:
        return [Finding("sha256", file["path"], "the content is not what was written")]
    with pq.ParquetFile(pa.BufferReader(data)) as parquet:
        findings = []
        if parquet.metadata.num_rows != file["rows"]:
            findings.append(
                Finding("rows", file["path"], f"{parquet.metadata.num_rows} rows; the marker says {file['rows']}")
            )
        if not parquet.schema_arrow.equals(arrow_schema(file["table"])):
            findings.append(Finding("schema", file["path"], f"columns are not those of table {file['table']!r}"))
        return findings
