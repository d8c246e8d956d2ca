"""Describe materials: permittivity at radio frequencies, appearance in visible light and LiDAR reflectance."""
