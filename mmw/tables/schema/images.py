"""Tables of images."""

from mmw.tables.schema.columns import IMAGE, OWNED, SENSOR, TableSpec, column

DEPTH = TableSpec(
    "depth",
    "One depth image.",
    (
        *OWNED,
        SENSOR,
        column(
            "image",
            IMAGE,
            "cm",
            "16-bit PNG of depth along the optical axis; metres = value * 0.01; 0 = no return",
            nullable=True,
        ),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=4,
    level=1,
)
