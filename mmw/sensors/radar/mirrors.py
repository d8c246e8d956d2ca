"""Tabulate mirror reflection of surfaces at the radar's carrier, by the description that the radio channel has."""

from collections.abc import Iterable, Sequence

import numpy as np

from mmw.physics.em.surface_response import SurfaceResponse
from mmw.physics.materials.material import Material
from mmw.physics.materials.permittivity import permittivity_table

COSINES = 2049
"""Cosines of incidence of the table: the interference of the faces of a pane, and the fall of TM reflection at grazing
incidence, are resolved. Design value; between two of them the error is below 2e-3 for a double pane at 77 GHz."""


def mirror_table(materials: Sequence[Material], used: Iterable[int], carrier_hz: float) -> np.ndarray:
    """Return the mirror reflection of materials in one weather, for `mmw.kernels.radar.echo_paths.mirror_reflection`.

    It is Fresnel's coefficient of half-space, slab or layers, times the share that roughness and scattering leave of a
    mirror's amplitude (`mmw.physics.em.surface_response`). Crowns of trees mirror nothing.

    Args:
        materials: Materials by id, as they are in the weather.
        used: Ids of the mirrors; the rows of the others are 0 and need no data.
        carrier_hz: Carrier frequency [Hz].

    Returns:
        Real and imaginary part of TE and of TM for e^{+jwt} at `COSINES` cosines from 0 to 1, shape [M, COSINES, 4],
        float32.

    Raises:
        InputError: If a mirror has no permittivity at the carrier.
    """
    rows = sorted(index for index in set(used) if materials[index].radio.medium != "foliage")
    table = np.zeros((len(materials), COSINES, 4), dtype=np.float32)
    if not rows:
        return table
    permittivity = permittivity_table(tuple(materials), [carrier_hz], rows)[:, 0]
    response = SurfaceResponse([material.radio for material in materials], permittivity, carrier_hz)
    cosine = np.tile(np.linspace(0.0, 1.0, COSINES), len(rows))
    index = np.repeat(rows, COSINES)
    share = response.specular_share(index, cosine)
    te, tm = (share * coefficient for coefficient in response.reflection(index, cosine))
    table[rows] = np.stack([te.real, te.imag, tm.real, tm.imag], axis=-1).reshape(len(rows), COSINES, 4)
    return table
