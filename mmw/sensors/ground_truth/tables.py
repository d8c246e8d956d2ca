"""Define the tables of what cameras see of objects."""

from mmw.storage.table_spec import F32, I32, OBJECT, OWNED, SENSOR, TableSpec, column, encoded_image, sensor_table

SEGMENTATION = sensor_table(
    "segmentation",
    "What each pixel of one depth or RGB image shows, from the same rays.",
    encoded_image("instance", "", "16-bit PNG; object_id = value - 1, a row of `objects`; 0 = nothing hit"),
    encoded_image("semantic", "", "8-bit PNG of CARLA tags as in `objects`; 11 (sky) = nothing hit"),
    frames_per_group=4,
    level=1,
)

EDGES = {"u_min": "left", "v_min": "upper", "u_max": "right", "v_max": "lower"}
"""Columns of a rectangle's edges."""

BOXES_2D = TableSpec(
    "boxes_2d",
    "One actor of which one camera frames a part of the 3-D box, seen or hidden, at any distance; the camera's own "
    "vehicle too. Columns u count to the right and rows v down from the top left edge of the image. Mirrors stick out "
    "of a vehicle's 3-D box, so its pixels may reach beyond the amodal rectangle.",
    (
        *OWNED,
        SENSOR,
        OBJECT,
        column("pixels", I32, "count", "pixels that show the actor"),
        *(
            column(
                name,
                I32,
                "px",
                f"{edge} edge of the pixels that show the actor; null if no pixel shows it",
                nullable=True,
            )
            for name, edge in EDGES.items()
        ),
        *(
            column(f"amodal_{name}", F32, "px", f"{edge} edge of the framed part of the 3-D box, hidden or not")
            for name, edge in EDGES.items()
        ),
        column(
            "truncation",
            F32,
            "-",
            "share of the rectangle around the whole 3-D box that the amodal one leaves out, 0 to 1; close to 1 if it "
            "reaches behind the camera",
        ),
        column("distance", F32, "m", "from the camera to the middle of the 3-D box"),
    ),
    ("frame", "agent", "sensor", "object_id"),
)
