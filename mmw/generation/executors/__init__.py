"""Executors: run the work of a dataset in this process, in several processes of this machine, or on a Ray cluster."""
