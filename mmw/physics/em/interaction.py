"""Number the interactions of a wave with its surroundings."""

SPECULAR, DIFFUSE, TRANSMISSION, DIFFRACTION = 1, 2, 4, 8
"""What a wave does on its way; the numbers are those of Sionna RT. 0 stands behind the last interaction."""

INTERACTIONS = {SPECULAR: "specular", DIFFUSE: "diffuse", TRANSMISSION: "transmission", DIFFRACTION: "diffraction"}
"""Name of each interaction."""
