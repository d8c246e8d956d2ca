"""Hold the rows of each topic, in `CHECKS`."""
