"""Kernels of the fields along paths against the same formulas in NumPy.

Tolerance: both take the same sums and products in float64, of numbers of size 1 and angles up to some hundred radians
(phases of slabs), so that they differ by some hundred times 2e-16.
"""

import numpy as np
import pytest

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.physics.em.field import (
    GivenMatrices,
    PathGeometry,
    combine,
    path_geometry,
    perpendicular,
    polarimetric_transfer,
)
from mmw.physics.em.fresnel import reflection, transmission
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR, TRANSMISSION
from mmw.physics.em.path_gain import material_table
from mmw.physics.em.surface_response import SurfaceResponse
from mmw.physics.materials.material import RadioMaterial
from tests.oracles import path_fields as oracle
from tests.oracles.channel import radio_materials

TOLERANCE = 1e-12
"""Of directions, matrices and coefficients, all of size 1."""
CARRIERS_HZ = (4.9e9, 28e9)
MATERIALS = tuple(
    radio_materials(
        {
            "wall": RadioMaterial("itu", itu="itu_concrete"),
            "pane": RadioMaterial("itu", itu="itu_glass", thickness=0.006),
            "metal": RadioMaterial("itu", itu="itu_pec"),
            "rough": RadioMaterial("itu", itu="itu_brick", thickness=0.2, scattering=0.4, rms_height=0.001),
        }
    ).values()
)


def units(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Return random unit vectors, shape [*shape, 3]."""
    values = rng.normal(size=(*shape, 3))
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def random_paths(count: int = 300, depth: int = 3) -> tuple[np.ndarray, ...]:
    """Return the arguments of `path_geometry` for paths of all kinds, some of them at odd angles."""
    rng = np.random.default_rng(7)
    order = rng.integers(0, depth + 1, count)
    is_there = np.arange(depth) < order[:, None]
    kind = np.where(is_there, rng.choice([SPECULAR, TRANSMISSION, DIFFUSE, DIFFRACTION], (count, depth)), 0)
    vertex = np.where(is_there[..., None], rng.uniform(-50.0, 50.0, (count, depth, 3)), np.nan)
    normal = np.where(is_there[..., None], units(rng, count, depth), np.nan)
    tx, rx, edge = *rng.uniform(-50.0, 50.0, (2, count, 3)), units(rng, count, depth)
    rx[0], kind[0] = tx[0] + [0.0, 0.0, 5.0], 0  # straight up
    rx[1], kind[1] = tx[1], 0  # no length
    kind[2], vertex[2], normal[2] = 0, np.nan, np.nan
    kind[2, 0], vertex[2, 0], normal[2, 0] = SPECULAR, tx[2] + [3.0, 4.0, 0.0], [0.6, 0.8, 0.0]  # normal incidence
    return tx, rx, kind.astype(np.int32), vertex, normal, edge


def geometry_of(tx: np.ndarray, rx: np.ndarray, *points: np.ndarray) -> PathGeometry:
    """Return the geometry of paths, each of a link of its own whose ends rest."""
    return path_geometry(np.arange(len(tx)), (tx, rx), (np.zeros(tx.shape), np.zeros(rx.shape)), *points)


def test_geometry_of_paths_of_all_kinds() -> None:
    given = random_paths()
    found, expected = geometry_of(*given), oracle.path_geometry(*given)
    for name, values in expected.items():
        scale = 100.0 if name == "segment_length" else 1.0
        np.testing.assert_allclose(getattr(found, name), values, rtol=0.0, atol=TOLERANCE * scale, err_msg=name)
    np.testing.assert_array_equal(found.interaction, given[2])
    one = geometry_of(*(values[40:41] for values in given))
    for name in expected:
        np.testing.assert_array_equal(getattr(one, name)[0], getattr(found, name)[40])  # no row looks at others


def test_no_paths() -> None:
    found = geometry_of(*(values[:0] for values in random_paths()))
    assert found.turn.shape == (0, 4, 2, 2) and found.length.shape == found.phi_r.shape == (0,)


def test_axes_across_rays() -> None:
    rng = np.random.default_rng(3)
    direction, normal = units(rng, 50), units(rng, 50)
    normal[:9] = direction[:9]
    direction[9], normal[9] = [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]
    expected = oracle.perpendicular(direction, normal)
    np.testing.assert_allclose(perpendicular(direction, normal), expected, rtol=0.0, atol=TOLERANCE)


def slabs() -> tuple[np.ndarray, ...]:
    """Return permittivity, cosine, thickness and carrier of many slabs: lossy, lossless, vacuum, opaque, conductors."""
    rng = np.random.default_rng(5)
    eta = rng.uniform(1.0, 12.0, 400) - 1j * 10.0 ** rng.uniform(-6.0, 2.0, 400)
    eta[:40], eta[40:60], eta[60:80] = eta[:40].real, 1.0, np.inf
    eta[80:90] = 81.0 - 4e4j
    cosine = rng.uniform(0.0, 1.0, 400)
    cosine[::20], cosine[1::20], cosine[2::20] = 0.0, 1.0, 1e-9
    thickness = rng.choice([0.0, 0.001, 0.02, 0.3], 400)
    thickness[(eta == 1.0) & (cosine == 0.0)] = 0.0  # along a slab of vacuum nothing is reflected or passed
    return eta, cosine, thickness, rng.choice([1e9, 28e9, 140e9], 400)


def test_slabs_against_complex_numpy() -> None:
    given = slabs()
    expected = oracle.slab(*given)
    for found, wanted in zip((reflection(*given), transmission(*given)), expected, strict=True):
        for part, values in zip(found, wanted, strict=True):
            np.testing.assert_allclose(part, values, rtol=0.0, atol=TOLERANCE)
    is_conductor, is_vacuum = np.isinf(given[0]), given[0] == 1.0
    te, tm = reflection(*given)
    assert (te[is_conductor] == -1.0).all() and (tm[is_conductor] == 1.0).all()
    assert (te[is_vacuum] == 0.0).all() and (tm[is_vacuum] == 0.0).all()


def test_slabs_of_other_shapes() -> None:
    eta, cosine = np.array([[4.0 - 0.1j], [9.0]]), np.array([0.2, 0.5, 1.0])
    te, tm = reflection(eta, cosine, 0.01, 28e9)
    assert te.shape == tm.shape == (2, 3)
    one, _ = reflection(np.array(9.0 + 0j), np.array(0.5), 0.01, 28e9)
    assert one == te[1, 1]


def test_shares_of_rough_materials() -> None:
    response = SurfaceResponse([material.radio for material in MATERIALS], np.full(4, 4.0 + 0j), 28e9)
    material, cosine = np.array([0, 3, 3, 1]), np.array([0.3, 0.1, 0.9, 1.0])
    scattering, height = np.array([0.0, 0.4, 0.4, 0.0]), np.array([0.0, 0.001, 0.001, 0.0])
    kept = oracle.mirror_share(scattering, height, cosine, np.full(4, 28e9))
    np.testing.assert_allclose(response.specular_share(material, cosine), kept, rtol=TOLERANCE)
    scattered = np.where(height > 0.0, np.sqrt(1.0 - kept**2), scattering)
    np.testing.assert_allclose(response.diffuse_share(material, cosine), scattered, rtol=TOLERANCE)


def test_one_table_serves_all_that_was_asked_for() -> None:
    """Only a material that no path met before makes the table anew: those of a path change from frame to frame."""
    narrow = RadioMaterial("function", permittivity=lambda hz: 3.0 - 0.1j, frequency_range_hz=(2e10, 4e10))
    coated = RadioMaterial("itu", itu="itu_glass", thickness=0.006, layers=("sheet 5",))
    others = radio_materials({"narrow": narrow, "coated": coated}).values()
    materials = (*MATERIALS, *others)
    first = material_table(materials, CARRIERS_HZ, [2])
    assert np.isnan(first.planes.permittivity.numpy()[:2, :, 0]).all() and first.ids == {2}
    both = material_table(materials, CARRIERS_HZ, [0])
    assert both.ids == {0, 2}
    assert material_table(materials, CARRIERS_HZ, [0, 2]) is material_table(materials, CARRIERS_HZ, []) is both
    copy = material_table((*materials,), CARRIERS_HZ, [2, 0])
    assert copy is not both
    np.testing.assert_array_equal(both.planes.permittivity.numpy(), copy.planes.permittivity.numpy())
    assert material_table(materials, CARRIERS_HZ, [5]).layered == {5}
    assert both.layered == frozenset() and material_table(materials, CARRIERS_HZ[1:], [4]).ids == {4}
    with pytest.raises(InputError, match=r"'narrow': no permittivity at 4\.9 GHz"):
        material_table(materials, CARRIERS_HZ, [0, 4])
    assert material_table(materials, CARRIERS_HZ, [0]).ids == {0, 2, 5}


@pytest.mark.parametrize("has_given", [False, True])
def test_transfer_of_planes(has_given: bool) -> None:
    """Reflections and passages follow from the materials, others from given matrices or are 0."""
    rng = np.random.default_rng(11)
    given = random_paths()
    geometry, kind = geometry_of(*given), given[2]
    (count, depth), carriers = kind.shape, len(CARRIERS_HZ)
    material_id = np.where(kind != 0, rng.integers(0, len(MATERIALS), kind.shape), -1).astype(np.int32)
    table = material_table(MATERIALS, CARRIERS_HZ, tuple(range(len(MATERIALS))))
    factor = rng.uniform(0.1, 1.0, (count, carriers))
    matrices = np.zeros((count, carriers, depth, 2, 2), dtype=np.complex128)
    matrices[(kind == 0)[:, None].repeat(carriers, axis=1)] = np.eye(2)
    for carrier, carrier_hz in enumerate(CARRIERS_HZ):
        eta = table.by_carrier[carrier].permittivity
        thickness, scattering, height = (
            np.array([getattr(material.radio, name) for material in MATERIALS])
            for name in ("thickness", "scattering", "rms_height")
        )
        for code in (SPECULAR, TRANSMISSION):
            path, step = np.nonzero(kind == code)
            index, cosine = material_id[path, step], geometry.cosine[path, step]
            pair = oracle.slab(eta[index], cosine, thickness[index], carrier_hz)[code == TRANSMISSION]
            share = oracle.mirror_share(scattering[index], height[index], cosine, carrier_hz)
            for row in range(2):
                matrices[path, carrier, step, row, row] = pair[row] * (share if code == SPECULAR else 1.0)
    own = None
    if has_given:
        own = GivenMatrices(np.isin(kind, (DIFFRACTION, DIFFUSE)), rng.normal(size=(*matrices.shape, 2)) @ [1.0, 1j])
        chosen = own.is_given[:, None].repeat(carriers, axis=1)
        matrices[chosen] = own.matrix[chosen]
    fields = rng.normal(size=(count, 2, 2, 2)) @ [1.0, 1j]
    found, between = polarimetric_transfer(geometry, material_id, table.planes, factor, own, fields=fields)
    expected = oracle.transfer(matrices, geometry.turn, factor)
    assert (np.abs(expected) > 0.0).any(axis=(1, 2, 3)).sum() > 100
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=TOLERANCE * np.abs(expected).max())
    coefficients = np.einsum("pi,pcij,pj->pc", fields[:, 1], expected, fields[:, 0])
    size = np.abs(coefficients).max()
    np.testing.assert_allclose(between, coefficients, rtol=0.0, atol=TOLERANCE * size)
    again, none = polarimetric_transfer(
        geometry, material_id, table.planes, factor, own, [lambda step, field: np.ones((count, 2))] * carriers
    )
    np.testing.assert_allclose(again, found, rtol=1e-14)  # step by step, with factors of 1 in between
    assert none.shape == (0, carriers)


def test_a_factor_before_an_interaction_is_that_of_a_column() -> None:
    """A patch weakens the field that comes to it: each of the transmitter's components by itself."""
    tx, rx = np.zeros((1, 3)), np.array([[20.0, 0.0, 0.0]])
    vertex, normal = np.array([[[10.0, 0.0, -5.0]]]), np.array([[[0.0, 0.0, 1.0]]])
    geometry = geometry_of(tx, rx, np.array([[SPECULAR]]), vertex, normal, normal)
    planes = material_table(MATERIALS, CARRIERS_HZ, (2,)).planes
    arguments = geometry, np.array([[2]]), planes, np.ones((1, 2))
    plain, _ = polarimetric_transfer(*arguments)
    columns = np.array([[[0.5, 0.25], [2.0, 4.0]]])
    functions = [lambda step, field, carrier=carrier: columns[:, carrier] for carrier in range(2)]
    weakened, _ = polarimetric_transfer(*arguments, None, functions)
    np.testing.assert_allclose(weakened, plain * columns[:, :, None], rtol=1e-14)
    np.testing.assert_allclose(geometry.length, 2.0 * np.hypot(10.0, 5.0), rtol=1e-15)


def test_coefficients_between_elements() -> None:
    rng = np.random.default_rng(2)
    receive, transmit = (rng.normal(size=(7, many, 2, 2)) @ [1.0, 1j] for many in (3, 2))
    transfer = rng.normal(size=(7, 4, 2, 2, 2)) @ [1.0, 1j]
    expected = np.einsum("pki,pcij,ptj->pckt", receive, transfer, transmit)
    np.testing.assert_allclose(combine(receive, transfer, transmit), expected, rtol=TOLERANCE, atol=TOLERANCE)
    real = combine(receive.real, transfer, transmit.real)
    expected = np.einsum("pki,pcij,ptj->pckt", receive.real, transfer, transmit.real)
    np.testing.assert_allclose(real, expected, rtol=TOLERANCE, atol=TOLERANCE)


def test_a_line_of_sight_is_friis() -> None:
    """Transfer 1 / (4 pi d / lambda), turned so that theta meets theta."""
    tx, rx = np.zeros((1, 3)), np.array([[30.0, 40.0, 0.0]])
    none = np.full((1, 1, 3), np.nan)
    geometry = geometry_of(tx, rx, np.zeros((1, 1), dtype=np.int32), none, none, none)
    planes = material_table(MATERIALS, CARRIERS_HZ, ()).planes
    factor = SPEED_OF_LIGHT / np.array(CARRIERS_HZ) / (4.0 * np.pi * 50.0)
    found, _ = polarimetric_transfer(geometry, np.array([[-1]]), planes, factor[None])
    expected = factor[:, None, None] * np.array([[1.0, 0.0], [0.0, -1.0]])
    np.testing.assert_allclose(found[0], expected, rtol=0.0, atol=1e-16)
