"""A scenario as one USD stage: the town, every vehicle at every frame, roadside units and sensors."""
