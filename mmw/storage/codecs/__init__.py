"""Encode images for columns of tables."""
