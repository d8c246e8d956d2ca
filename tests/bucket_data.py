"""A small dataset of two shards for tests of stores, made as a run makes one."""

import sys

from mmw.tables.bucket import Bucket
from mmw.tables.manifest import keep_finished, pending, pending_shards, prepare_root
from mmw.tables.store import Store
from mmw.tables.writer import ShardKey, write_scenario, write_shard
from tests.shards import IDENTITY, META, make_shard, make_statics

KEYS = [ShardKey("town_a", weather, 0, 2) for weather in ("rainy", "sunny")]
TABLES = ("frames", "lidar")
PUTS = 1 + 2 + 2 * (len(TABLES) + 1)
"""Its objects but manifest and card: `dataset.json`, one static table, two shards, markers."""


def make(root: Store, *, overwrite: bool = False, **changes: object) -> None:
    """Make what is missing of it.

    Args:
        root: Where.
        overwrite: Replace another dataset.
        changes: Of the configuration.
    """
    sha256 = META["config_sha256"] if not changes else "d" * 64
    prepare_root(root, IDENTITY | changes, sha256, {"mmw": "0.1.0"}, overwrite)
    keep_finished(root, pending_shards(root, KEYS))
    meta = META | {"config_sha256": sha256}
    for key in pending(root, ["town_a", *KEYS]):
        if isinstance(key, str):
            write_scenario(root, key, {"objects": make_statics()["objects"]}, meta)
        else:
            shard = make_shard(key)
            write_shard(root, key, {name: shard[name] for name in TABLES}, meta)
    root.leave()


if __name__ == "__main__":
    make(Bucket(sys.argv[1], sys.argv[2]))
