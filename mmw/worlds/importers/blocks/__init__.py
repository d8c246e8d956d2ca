"""Build sidewalks, buildings and furniture along imported roads."""
