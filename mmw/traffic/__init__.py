"""Move actors: vehicles, as bodies that stand on their wheels, and pedestrians."""
