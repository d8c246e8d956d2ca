"""Vehicle models: their dimensions, the builder of their USD assets, and the catalogue that traffic and stages read."""
