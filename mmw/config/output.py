"""`output`: where the tables go and how they are cut into files."""

from pydantic import Field, field_validator

from mmw.config.section import PathText, Section
from mmw.core.licenses import license_name


class OutputConfig(Section):
    """The dataset folder and its shards."""

    dir: PathText = Field(
        default="out/dataset",
        description="dataset folder, relative to the working directory, or s3://bucket/folder; `--out` replaces it "
        "(path)",
    )
    staging: PathText | None = Field(
        default=None,
        description="folder on this machine for what is on its way to a store; in the user's cache if absent (path)",
    )
    shard_frames: int = Field(
        default=100, ge=1, le=10_000, description="frames in one shard: the unit of writing and resuming (count)"
    )
    license: str = Field(
        default="CC-BY-4.0",
        description="license of the data, written into the dataset: SPDX identifier, or text (name)",
    )
    notices: tuple[str, ...] = Field(
        default=(), description="what has to be named with the data, besides the notices of imported towns (texts)"
    )

    @field_validator("license")
    @classmethod
    def _spelled(cls, value: str) -> str:
        return license_name(value)


def folder_below(root: str, name: str) -> str:
    """Return the folder of a dataset below that of its sweep; options of a URL stay at the end."""
    path, mark, options = root.partition("?") if "://" in root else (root, "", "")
    return f"{path.rstrip('/')}/{name}{mark}{options}"
