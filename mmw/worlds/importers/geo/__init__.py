"""Place imported maps on the earth, merge them, and lay them over height rasters."""
