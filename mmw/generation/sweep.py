"""Generate the datasets of a sweep, and sum up what they will be."""

from collections.abc import Sequence
from pathlib import Path

from mmw.config.load import in_config
from mmw.config.sweep_members import SweepMember
from mmw.generation.run_config import DEFAULT_OPTIONS, RunOptions, describe_config, run_datasets


def run_sweep(
    members: Sequence[SweepMember], root: str, base: Path, place: Path | str, options: RunOptions = DEFAULT_OPTIONS
) -> None:
    """Generate the datasets of a sweep, or a part of each, and write its index; finished ones are left as they are.

    Args:
        members: The datasets.
        root: Folder of all, or `s3://bucket/folder`.
        base: Folder that relative paths of input files start from.
        place: File of the configuration, or words for one that is no file.
        options: How.

    Raises:
        InputError: If a configuration or a file that it names cannot be used, or the folder is one dataset.
        Error: If the disk or the memory is full, workers die, or a store cannot be reached.
    """
    from mmw.storage.sweep_index import write_index

    def begin() -> None:
        write_index(root, [member.record for member in members])

    datasets = [(member.config, member.provenance) for member in members]
    run_datasets(datasets, base, place, options, begin=begin)


def describe_sweep(members: Sequence[SweepMember], root: str, base: Path, place: Path | str, shard: str = "0/1") -> str:
    """Return the text of `--dry-run`: a line for each dataset, and the sum; no frame is traced for it.

    Raises:
        InputError: As `run_sweep`.
    """
    from mmw.generation.estimate import count_agents, estimate_plan
    from mmw.generation.progress import si

    lines = [f"{len(members)} dataset(s) below {root}:"]
    frames = rays = size = 0.0
    for member in members:
        with in_config(place):
            describe_config(member.config, base, place, shard, is_quick=True)  # checks it
            plan = estimate_plan(member.config, base, count_agents(member.config, base))
        frames, rays, size = frames + member.config.frame_total, rays + plan.rays, size + plan.bytes
        lines.append(
            f"  {member.name}: {member.config.frame_total:,} frames, {si(plan.rays)}rays, about {si(plan.bytes)}B"
        )
    lines.append(f"total: {frames:,.0f} frames, {si(rays)}rays, tables of about {si(size)}B")
    return "\n".join(lines)
