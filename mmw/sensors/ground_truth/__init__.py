"""Compute bounding boxes, segmentation and visibility."""
