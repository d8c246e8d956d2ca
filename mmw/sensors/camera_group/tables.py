"""Tables of images, and of what they frame."""

from mmw.storage.table_spec import F32, I32, NAME, OBJECT, OWNED, SENSOR, TableSpec, column, encoded_image, list_of

RGB = TableSpec(
    "rgb",
    "One image of an RGB camera.",
    (
        *OWNED,
        SENSOR,
        encoded_image("image", "", "8-bit sRGB colours, a JPEG or PNG file; row 0 is the top"),
        column("format", NAME, "", "jpeg or png"),
        column("exposure", F32, "m2/kcd", "factor from luminance [kcd/m2] to display linear, where 1 is white"),
        column("ev100", F32, "-", "the same as exposure value at ISO 100: white = 1.2 * 2^EV100 cd/m2"),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=4,
    level=1,
)

DEPTH = TableSpec(
    "depth",
    "One depth image.",
    (
        *OWNED,
        SENSOR,
        encoded_image(
            "image",
            "cm",
            "16-bit PNG of depth along the optical axis; metres = value * 0.01; 0 = no return",
        ),
        column(
            "depth_m",
            list_of(F32),
            "m",
            "depth before rounding, row after row from the top left pixel; 0 = no return; null unless the sensor has "
            "`format: float32`, and only there beyond 655.35 m, where the image is 0",
            nullable=True,
        ),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=4,
    level=1,
)

SEGMENTATION = TableSpec(
    "segmentation",
    "What each pixel of one depth or RGB image shows, from the same rays.",
    (
        *OWNED,
        SENSOR,
        encoded_image("instance", "", "16-bit PNG; object_id = value - 1, a row of `objects`; 0 = nothing hit"),
        encoded_image("semantic", "", "8-bit PNG of CARLA tags as in `objects`; 11 (sky) = nothing hit"),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=4,
    level=1,
)

NORMALS = TableSpec(
    "normals",
    "Normals of the surfaces that the pixel centres of one RGB image show, from the same rays.",
    (
        *OWNED,
        SENSOR,
        encoded_image(
            "image",
            "",
            "8-bit PNG; red, green, blue = x, y, z of the unit normal in the sensor frame (x forward, y left, z up), "
            "towards the camera: (value - 128) / 127; 0, 0, 0 = nothing hit",
        ),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=4,
    level=1,
)

FLOW = TableSpec(
    "flow",
    "Optical flow from one RGB image to the next frame (10 ms), from the same rays: own motion and that of actors.",
    (
        *OWNED,
        SENSOR,
        encoded_image(
            "image",
            "",
            "16-bit RGB PNG as KITTI's: u = (red - 32768) / 64 px to the right, v = (green - 32768) / 64 px down; "
            "blue = 1, or 0 for none (512 px and more)",
        ),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=4,
    level=1,
)

HIDDEN = "; null if no pixel shows it"

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
        column("u_min", I32, "px", "left edge of the pixels that show the actor" + HIDDEN, nullable=True),
        column("v_min", I32, "px", "upper edge of the pixels that show the actor" + HIDDEN, nullable=True),
        column("u_max", I32, "px", "right edge of the pixels that show the actor" + HIDDEN, nullable=True),
        column("v_max", I32, "px", "lower edge of the pixels that show the actor" + HIDDEN, nullable=True),
        column("amodal_u_min", F32, "px", "left edge of the framed part of the 3-D box, hidden or not"),
        column("amodal_v_min", F32, "px", "upper edge of the framed part of the 3-D box, hidden or not"),
        column("amodal_u_max", F32, "px", "right edge of the framed part of the 3-D box, hidden or not"),
        column("amodal_v_max", F32, "px", "lower edge of the framed part of the 3-D box, hidden or not"),
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
