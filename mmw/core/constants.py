"""Physical constants and the usual frame rate. Source of the SI values: CODATA 2022."""

SPEED_OF_LIGHT = 299_792_458.0
"""Speed of light in vacuum [m/s], exact."""

VACUUM_PERMITTIVITY = 8.854_187_8188e-12
"""Electric constant [F/m], CODATA 2022 (as SciPy 1.15 and later)."""

GRAVITY = 9.81
"""Acceleration of gravity that the IMU model uses [m/s^2]: CARLA's value, so that rest reads +9.81 on z."""

FRAME_RATE_HZ = 100
"""Frames per second unless a scenario has another rate, one per 5G NR frame (10 ms); traffic is made at it."""

FRAME_DT = 1.0 / FRAME_RATE_HZ
"""Time between those frames [s]."""
