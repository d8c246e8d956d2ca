"""Exporters: a dataset as files of other people's tools. `exporter` runs the tasks of every format."""
