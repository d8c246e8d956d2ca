"""Point clouds as PCD files, version 0.7, binary.

Source: "The PCD (Point Cloud Data) file format", documentation of the Point Cloud Library.
"""

import numpy as np

RGB = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
"""A point with a colour, red << 16 | green << 8 | blue."""


def pcd_bytes(points: np.ndarray) -> bytes:
    """Return a PCD file of a structured array [N], one field of the file a field of the array."""
    names = points.dtype.names or ()
    formats = [points.dtype[name] for name in names]
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        f"FIELDS {' '.join(names)}\n"
        f"SIZE {' '.join(str(form.itemsize) for form in formats)}\n"
        f"TYPE {' '.join(form.kind.upper() for form in formats)}\n"
        f"COUNT {' '.join('1' for _ in names)}\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA binary\n"
    )
    return header.encode("ascii") + points.tobytes()


def intensity_pcd(xyz: np.ndarray, intensity: np.ndarray) -> bytes:
    """Return a PCD file whose red channel is the intensity, as OPV2V's.

    Args:
        xyz: Points [m], shape [N, 3].
        intensity: 0 to 1, shape [N]; rounded to 8 bits.
    """
    points = np.empty(len(xyz), RGB)
    for axis, name in enumerate("xyz"):
        points[name] = xyz[:, axis]
    points["rgb"] = np.rint(255.0 * np.clip(intensity, 0.0, 1.0)).astype(np.uint32) << 16
    return pcd_bytes(points)
