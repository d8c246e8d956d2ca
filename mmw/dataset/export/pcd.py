"""Point clouds as PCD files, version 0.7, binary.

Source: "The PCD (Point Cloud Data) file format", documentation of the Point Cloud Library.
"""

import numpy as np

RGB = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
"""A point with a color, red << 16 | green << 8 | blue."""


def intensity_pcd(xyz: np.ndarray, intensity: np.ndarray) -> bytes:
    """Return a PCD file of points [m], shape [N, 3], whose red channel is the intensity, as OPV2V's.

    The intensity, 0 to 1, shape [N], is rounded to 8 bits.
    """
    points = np.empty(len(xyz), RGB)
    for axis, name in enumerate("xyz"):
        points[name] = xyz[:, axis]
    points["rgb"] = np.rint(255.0 * np.clip(intensity, 0.0, 1.0)).astype(np.uint32) << 16
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\n"
        f"COUNT 1 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA binary\n"
    )
    return header.encode("ascii") + points.tobytes()
