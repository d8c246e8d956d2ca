"""Engines: who makes the work of a dataset, in this process, in several of this machine, or on a Ray cluster."""
