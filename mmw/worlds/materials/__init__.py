"""Draw the textures of the material library."""
