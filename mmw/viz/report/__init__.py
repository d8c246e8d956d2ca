"""One HTML page about a dataset: pictures, maps, links, counts and provenance, in a single file that asks no other."""

from mmw.viz.report.page import make_report

__all__ = ["make_report"]
