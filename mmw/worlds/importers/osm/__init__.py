"""Read OpenStreetMap extracts."""
