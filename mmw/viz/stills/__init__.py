"""Render pictures of stages, scenarios and datasets."""
