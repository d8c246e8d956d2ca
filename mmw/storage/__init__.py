"""The dataset's tables: their schemas, and how shards are written, listed and verified."""
