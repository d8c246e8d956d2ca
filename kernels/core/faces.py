"""Faces of the town and of vehicles by their numbers: rows, corners, normals."""

import warp as wp

from mmw.kernels.core.structs import Scene

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.func
def face_row(scene: Scene, face: int, instance: int) -> int:
    """Return the row of a face in `Scene.town_*`, or of an instance's face in `Scene.model_*`."""
    row = face
    if instance >= 0:
        row = scene.instance_face_offset[instance] + face
    return row


@wp.func
def face_corners(scene: Scene, face: int, instance: int) -> wp.mat33:
    """Return the corners of a face as the rows of a matrix, in the frame of its mesh [m]."""
    row = face_row(scene, face, instance)
    if instance >= 0:
        a = scene.model_corner[row, 0]
        b = scene.model_corner[row, 1]
        c = scene.model_corner[row, 2]
    else:
        a = scene.town_corner[row, 0]
        b = scene.town_corner[row, 1]
        c = scene.town_corner[row, 2]
    return wp.matrix_from_rows(a, b, c)


@wp.func
def face_normal(scene: Scene, face: int, instance: int) -> wp.vec3:
    """Return the unit normal of a face after its winding, in the frame of its mesh; zero for a face without area."""
    corners = face_corners(scene, face, instance)
    return wp.normalize(wp.cross(corners[1] - corners[0], corners[2] - corners[0]))


@wp.func
def material_of(scene: Scene, face: int, instance: int) -> int:
    """Return the material id of a face."""
    row = face_row(scene, face, instance)
    if instance >= 0:
        return scene.model_material[row]
    return scene.town_material[row]
