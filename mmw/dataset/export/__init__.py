"""Exporters: a dataset as files of other people's tools. `base` has the frame that every format fills in."""
