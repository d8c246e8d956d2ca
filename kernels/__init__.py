"""Warp kernels, imported as `mmw.kernels`."""
