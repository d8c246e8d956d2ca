"""`compute`: which device traces and how much at a time. Nothing here changes a single byte of the data."""

from pydantic import Field

from mmw.config.section import Section


class ComputeConfig(Section):
    """Device and batch size; both are left out of the dataset's identity."""

    device: str = Field("auto", description="`auto` (first CUDA device, else the CPU), `cpu`, or `cuda:N` (name)")
    batch_frames: int = Field(
        50, ge=1, le=1024, description="frames traced in one launch; `--batch-frames` replaces it (count)"
    )
    writer_threads: int = Field(8, ge=1, le=64, description="threads that encode and write shards (count)")
