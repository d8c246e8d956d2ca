"""Describe what is wrong with a dataset, or could not be checked."""

from dataclasses import dataclass

HARMLESS = ("temporary", "note", "mixed")
"""Kinds of findings that are no error."""


@dataclass(frozen=True)
class Finding:
    """Problem of a dataset, or a note."""

    kind: str
    """missing, unreadable, size, sha256, parquet, rows, schema, key, duplicate, value, orphan, foreign, config, inputs,
    versions, license, marker, manifest, count, friis, sight, box, regenerated: the data is incomplete or wrong.
    temporary: a file of a killed run that no reader takes and a rerun removes. mixed: shards of several versions or
    kinds of machine, which the one who ran them accepted. note: anything that could not be checked."""
    path: str
    """File, relative to the dataset folder."""
    text: str

    @property
    def is_error(self) -> bool:
        """True if data is missing or damaged; False for harmless files and notes."""
        return self.kind not in HARMLESS

    def __str__(self) -> str:
        return f"{self.kind}: {self.path}: {self.text}"


def one_line(error: BaseException) -> str:
    """Return the message of an error on one line."""
    return " ".join(str(error).split())
