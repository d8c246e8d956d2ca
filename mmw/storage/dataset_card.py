"""Write the dataset card: what a folder holds, for people and for the Hugging Face Hub."""

from collections.abc import Iterable, Mapping
from typing import Any

from mmw.core.licenses import OWN
from mmw.storage.schemas import TABLES
from mmw.storage.store import DATASET

CARD = "README.md"
LICENSE, NOTICE = "LICENSE", "NOTICE"
"""License of the data, and what has to be named with them; written by `mmw.generation.provenance`."""
CONFIG = "config.yaml"
"""The resolved configuration, a valid argument of `--config`; written by `mmw.generation.provenance`."""


def hub_license(identifier: str) -> str:
    """Return a license as the metadata of a card names it on the Hugging Face Hub."""
    return "other" if identifier == OWN else identifier.lower()


def dataset_card(
    head: Mapping[str, Any],
    tables: Mapping[str, Mapping[str, int]],
    license_id: str = "",
    notes: Mapping[str, Iterable[str]] | None = None,
) -> str:
    """Return the text of the dataset card: one Hugging Face configuration per table, and a list of the tables.

    Args:
        head: Content of `dataset.json`.
        tables: Table -> files, rows and bytes.
        license_id: SPDX identifier of the license.
        notes: Scenario -> what users should know of it.
    """
    licensed = f"license: {hub_license(license_id)}\n" if license_id else ""
    said = f"License: {license_id}, see `{LICENSE}` and `{NOTICE}`.\n\n" if license_id else ""
    listed = "".join(f"- {name}: {line}\n" for name, lines in (notes or {}).items() for line in lines)
    listed = f"## Notes\n\n{listed}\n" if listed else ""
    configs = "".join(f"- config_name: {name}\n  data_files: {name}/**/*.parquet\n" for name in tables)
    rows = "".join(
        f"| {name} | {TABLES[name].doc if name in TABLES else ''} | {t['rows']:,} | {t['bytes'] / 1e6:,.1f} |\n"
        for name, t in tables.items()
    )
    version, sha256 = f"mmw {head['versions'].get('mmw', '')}".rstrip(), head["config_sha256"][:12]
    return f"""---
{licensed}configs:
{configs}---

# Multimodal wireless dataset

Made with {version}, schema {head["schema_version"]}, configuration `{sha256}` (the whole of it is in `{DATASET}`; `{CONFIG}` makes it again).

| table | one row is | rows | MB |
|---|---|---:|---:|
{rows}
{said}{listed}Every column has its unit and meaning in the files' `mmw.columns` key. Read with any Parquet reader, or:

```python
import mmw

mmw.connect(".").sql("SELECT * FROM {next(iter(tables), "frames")} LIMIT 5")
```
"""  # noqa: E501
