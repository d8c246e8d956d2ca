"""Read OpenDRIVE maps."""
