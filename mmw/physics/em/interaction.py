"""Number the interactions of a wave with its surroundings."""

SPECULAR, DIFFUSE, TRANSMISSION, DIFFRACTION = 1, 2, 4, 8
"""Types of interaction; the numbers are those of Sionna RT. 0 fills the rows behind the last interaction."""
