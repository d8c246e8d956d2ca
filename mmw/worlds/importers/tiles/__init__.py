"""Read 3D Tiles."""
