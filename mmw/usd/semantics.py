"""Semantic classes: label on the prim (`SemanticsLabelsAPI:class`) and the number that CARLA gives it.

Source: CARLA 0.9.14 and later, `ref_sensors.md`, semantic segmentation camera.
"""

TAXONOMY = "class"
"""Instance name of `SemanticsLabelsAPI`, as Isaac Lab uses it."""

CARLA_TAG = {
    "unlabeled": 0, "road": 1, "sidewalk": 2, "building": 3, "wall": 4, "fence": 5, "pole": 6, "traffic_light": 7,
    "traffic_sign": 8, "vegetation": 9, "terrain": 10, "sky": 11, "pedestrian": 12, "rider": 13, "car": 14, "truck": 15,
    "bus": 16, "train": 17, "motorcycle": 18, "bicycle": 19, "static": 20, "dynamic": 21, "other": 22, "water": 23,
    "road_line": 24, "ground": 25, "bridge": 26, "rail_track": 27, "guard_rail": 28,
}  # fmt: skip
"""Label -> CARLA semantic tag."""
