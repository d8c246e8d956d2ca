"""Trace propagation paths and radio maps."""
