"""Verify more than files and hashes: counts against the plan, physics, regenerated rows."""
