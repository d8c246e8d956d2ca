"""Kernels of inertial measurement units and satellite navigation receivers; they run on the host."""
