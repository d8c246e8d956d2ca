"""Save an episode: its stage with the poses that were driven, and the rows that the generator traces from it."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from mmw.config import Config, ScenarioConfig
from mmw.generation.executors.executor import open_executor
from mmw.generation.generate import generate_dataset
from mmw.generation.progress import Console
from mmw.generation.shards import Partition
from mmw.generation.shared_stages import SharedStages
from mmw.scene.prepare import write_stage
from mmw.scene.stage_digests import Spans
from mmw.storage.manifest import read_dataset
from mmw.storage.store import Store
from mmw.traffic.demand import VehicleTrack


class RecordedStage(SharedStages):
    """Stage of an episode, put into a dataset before its scenario would be prepared."""

    def __init__(self, config: Config, scenario: ScenarioConfig, base: Path, tracks: Sequence[VehicleTrack]) -> None:
        """Take what was driven.

        Args:
            config: Configuration of the dataset, with the frames that were seen.
            scenario: Its only scenario.
            base: Folder that relative paths start from.
            tracks: All actors, from frame 0 to one frame beyond the last.
        """
        super().__init__()
        self._config, self._scenario, self._base, self._tracks = config, scenario, base, tracks

    def share(self, config: Config, root: Store) -> None:
        """Write the stage into a dataset that has been begun."""
        inputs = read_dataset(root).get("inputs") or {}
        write_stage(
            self._config,
            self._scenario,
            self._base,
            root.folder,
            self._tracks,
            inputs.get(self._scenario.name),
            {"motion": "driven live, see docs/guides/closed-loop.md"},
            absent_spans(self._tracks),
        )
        self.copied += 1

    def write_dataset(self, place: Path | str, overwrite: bool) -> None:
        """Trace all frames from the stage, as `mmw.generate` does.

        Raises:
            InputError: If the folder has other data, or cannot be written.
            OutOfSpaceError: If the disk is full.
        """
        with ExitStack() as stack:
            console = stack.enter_context(Console(is_quiet=True))
            executor = stack.enter_context(open_executor(self._config.compute, console))
            generate_dataset(
                self._config,
                base=self._base,
                executor=executor,
                part=Partition.parse("0/1"),
                overwrite=overwrite,
                console=console,
                stages=self,
            )


def absent_spans(tracks: Sequence[VehicleTrack]) -> Spans:
    """Return the frames in which actors are absent, of those that are."""
    found = {}
    for track in tracks:
        is_absent = ~np.isfinite(track.poses).all(axis=1)
        ends = np.flatnonzero(np.diff(np.concatenate([[False], is_absent, [False]]).astype(np.int8)))
        if len(ends):
            found[track.name] = ends.reshape(-1, 2).tolist()
    return found
