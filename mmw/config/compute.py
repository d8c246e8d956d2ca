"""`compute`: which device traces and how much at a time. Nothing here changes a single byte of the data."""

from typing import Literal

from pydantic import Field, field_validator

from mmw.config.section import Section


class ComputeConfig(Section):
    """Devices, workers and batch size; all are left out of the dataset's identity."""

    device: str = Field("auto", description="`auto` (first CUDA device, else the CPU), `cpu`, or `cuda:N` (name)")
    batch_frames: int = Field(
        50, ge=1, le=1024, description="frames traced in one launch; `--batch-frames` replaces it (count)"
    )
    workers: int | Literal["auto"] = Field(
        "auto",
        description="processes that trace: `auto` is one a CUDA device with `device: auto`, on the CPU one a core, and "
        "never more than there are pieces of work; `--workers` replaces it (count)",
    )
    writer_threads: int = Field(
        8, ge=1, le=64, description="threads of each worker that encode and write shards (count)"
    )

    @field_validator("workers")
    @classmethod
    def _some(cls, value: int | str) -> int | str:
        if isinstance(value, int) and not 1 <= value <= 1024:
            raise ValueError(f"{value} workers make nothing; give 1 to 1024, or auto")
        return value
