"""One HTML page about a dataset: pictures, maps, links, counts and provenance, in a single file that asks no other."""

from mmw.reporting.page import make_report

__all__ = ["make_report"]
