"""Edges of meshes, and which of their bodies close or are inside out, for boxes and sheets that touch."""

import numpy as np
import pytest

from mmw.scene.mesh_edges import find_edges
from tests.fixtures.scenes import box_mesh

POINTS, FACES = box_mesh((2.0, 3.0, 4.0))
FIN = np.array([[1.0, 1.5, 2.0], [6.0, 1.5, 2.0], [6.0, 1.5, -2.0], [1.0, 1.5, -2.0]])
SHEET = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("is_turned", [(False, False), (True, False), (False, True)])
def test_boxes_that_share_an_edge_are_two_bodies(is_turned: tuple[bool, bool]) -> None:
    """Each closes, and each that is inside out is turned, whichever comes first: all normals point outward."""
    own = [FACES[:, ::-1] if turned else FACES for turned in is_turned]
    apart = np.array([2.0, 3.0, 0.0])
    mesh = find_edges(np.concatenate([POINTS, POINTS + apart]), np.concatenate([own[0], own[1] + 8]))
    assert sorted(mesh.size[mesh.size > 2]) == [4] and not mesh.is_open.any()
    np.testing.assert_array_equal(mesh.body, np.repeat([0, 12], 12))
    np.testing.assert_array_equal(mesh.is_turned, np.repeat(is_turned, 12))
    middle = np.repeat([0.0 * apart, apart], 12, axis=0)
    assert (np.einsum("fk,fk->f", mesh.normal, mesh.corner[:, 0] - middle) > 0.5).all()


@pytest.mark.parametrize("is_first", [True, False])
def test_a_sheet_on_the_edge_of_a_box_does_not_open_it(is_first: bool) -> None:
    """The box closes without it, in either order of the faces."""
    meshes = [(POINTS, FACES, False), (FIN, SHEET, True)][:: -1 if is_first else 1]
    (p0, f0, open_0), (p1, f1, open_1) = meshes
    mesh = find_edges(np.concatenate([p0, p1]), np.concatenate([f0, f1 + len(p0)]))
    np.testing.assert_array_equal(mesh.is_open, np.repeat([open_0, open_1], [len(f0), len(f1)]))


def test_a_box_without_a_face_is_open_and_faces_without_area_change_nothing() -> None:
    """A triangle less opens a box; two on one line do not."""
    assert find_edges(POINTS, FACES[1:]).is_open.all()
    flat = np.concatenate([FACES, [[0, 0, 1], [2, 2, 2]]])
    assert not find_edges(POINTS, flat).is_open[:12].any() and len(find_edges(POINTS, flat).first) == 18


def test_a_mesh_may_have_no_faces() -> None:
    """It has no edges then."""
    mesh = find_edges(POINTS, FACES[:0])
    assert len(mesh.first) == len(mesh.size) == len(mesh.body) == 0
