"""Import SUMO networks: lanes, junctions, crossings and sidewalks in plan."""
