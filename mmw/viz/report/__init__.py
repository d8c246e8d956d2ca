"""One HTML page about a dataset: pictures, maps, links, counts and provenance, in one self-contained file."""

from mmw.viz.report.page import make_report

__all__ = ["make_report"]
