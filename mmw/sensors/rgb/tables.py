"""Define the tables of RGB cameras."""

from mmw.storage.table_spec import F32, NAME, column, encoded_image, sensor_table

RGB = sensor_table(
    "rgb",
    "One image of an RGB camera.",
    encoded_image("image", "", "8-bit sRGB colors, a JPEG or PNG file; row 0 is the top"),
    column("format", NAME, "", "jpeg or png"),
    column("exposure", F32, "m2/kcd", "factor from luminance [kcd/m2] to display linear, where 1 is white"),
    column("ev100", F32, "-", "the same as exposure value at ISO 100: white = 1.2 * 2^EV100 cd/m2"),
    frames_per_group=4,
    level=1,
)

NORMALS = sensor_table(
    "normals",
    "Normals of the surfaces that the pixel centers of one RGB image show, from the same rays.",
    encoded_image(
        "image",
        "",
        "8-bit PNG; red, green, blue = x, y, z of the unit normal in the sensor frame (x forward, y left, z up), "
        "towards the camera: (value - 128) / 127; 0, 0, 0 = nothing hit",
    ),
    frames_per_group=4,
    level=1,
)

FLOW = sensor_table(
    "flow",
    "Optical flow from one RGB image to the next frame (10 ms), from the same rays: own motion and that of actors.",
    encoded_image(
        "image",
        "",
        "16-bit RGB PNG as KITTI's: u = (red - 32768) / 64 px to the right, v = (green - 32768) / 64 px down; "
        "blue = 1, or 0 for none (512 px and more)",
    ),
    frames_per_group=4,
    level=1,
)
