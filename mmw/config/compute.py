"""`compute`: devices and batch size. It changes no data but last bits (`docs/concepts/determinism.md`)."""

from typing import Literal

from pydantic import Field, field_validator

from mmw.config.section import Section
from mmw.core.bvh_default import BvhKind, default_bvh
from mmw.core.errors import InputError


class ComputeConfig(Section):
    """Devices, workers and batch size; all are left out of the dataset's identity."""

    engine: Literal["local", "ray"] = Field(
        default="local",
        description="workers are `local` processes of this machine, or actors of a Ray cluster, `ray` (extra `ray`); "
        "`--engine` replaces it (name)",
    )
    device: str = Field(
        default="auto", description="`auto` (first CUDA device, else the CPU), `cpu`, or `cuda:N` (name)"
    )
    bvh: BvhKind = Field(
        default_factory=default_bvh,
        json_schema_extra={"default": "wide"},
        description="BVHs for ray tracing: `wide` for our own, the faster ones, `warp` for Warp's, without native "
        "code; the default is that of the environment variable `MMW_BVH`, if set (name)",
    )
    batch_frames: int = Field(
        default=50, ge=1, le=1024, description="frames traced in one launch; `--batch-frames` replaces it (count)"
    )
    workers: int | Literal["auto"] = Field(
        default="auto",
        description="processes that trace: `auto` is one a core on the CPU, on each CUDA device one for two cores as "
        "far as memory allows, and never more than the work is worth; `--workers` replaces it (count)",
    )
    writer_threads: int | Literal["auto"] = Field(
        default="auto",
        description="threads of each worker that encode and write shards: `auto` is three for each core, divided among "
        "the workers, 4 to 16 (count)",
    )

    @field_validator("writer_threads")
    @classmethod
    def _a_few(cls, value: int | str) -> int | str:
        if isinstance(value, int) and not 1 <= value <= 64:
            raise InputError(f"{value} threads; give 1 to 64, or auto")
        return value

    @field_validator("workers")
    @classmethod
    def _some(cls, value: int | str) -> int | str:
        if isinstance(value, int) and not 1 <= value <= 1024:
            raise InputError(f"{value} workers make nothing; give 1 to 1024, or auto")
        return value
