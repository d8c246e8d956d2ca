"""Read the lanes, sidewalks and drivable surfaces of a town."""
