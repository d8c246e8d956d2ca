"""Trace propagation paths."""
