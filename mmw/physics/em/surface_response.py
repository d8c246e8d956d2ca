"""Answer how materials reflect, transmit and scatter at a carrier: the one place that reads their radio description.

Rough surfaces: heights with a Gaussian distribution of standard deviation s weaken the mirror reflection by
rho = exp(-8 (pi s cos / lambda)^2). With the scattering coefficient S, the mirror keeps (1 - S^2) rho^2 of the
reflected power and the rest is scattered: S_eff^2 = 1 - (1 - S^2) rho^2, so that together they are always what a smooth
surface reflects.

Source: W. S. Ament, "Toward a theory of reflection by a rough surface", Proc. IRE 41(1), 1953; in this form in
O. Landron, M. J. Feuerstein and T. S. Rappaport, "A comparison of theoretical and empirical reflection coefficients for
typical exterior wall surfaces in a mobile radio environment", IEEE Trans. AP 44(3), 1996. S after V. Degli-Esposti et
al., IEEE Trans. AP 55(1), 2007.
"""

from collections.abc import Sequence

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.host_kernels import run_on_host
from mmw.core.remember import remembered
from mmw.kernels.channel.plane_response import mirror_share_kernel
from mmw.physics.em.fresnel import reflection, transmission
from mmw.physics.em.layered import StackCoefficients, StackLayer, stack_coefficients
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.materials.permittivity import layer_permittivities, relative_permittivity


class SurfaceResponse:
    """Coefficients of materials, each at one carrier.

    Args:
        radios: Radio descriptions by id.
        permittivity: Their complex relative permittivities at the carrier, shape [M]; NaN where none is asked for.
        carrier_hz: Carrier frequency of all or of each [Hz], shape [M].
    """

    def __init__(self, radios: Sequence[RadioMaterial], permittivity: np.ndarray, carrier_hz: float | np.ndarray):
        """Prepare the arrays; stacks of layers are made where they are asked for."""
        self._radios, self.permittivity = tuple(radios), permittivity
        self._carrier_hz = np.full(len(permittivity), carrier_hz, dtype=np.float64)
        numbers, self._layered = _radio_numbers(self._radios)
        self._thickness, self._scattering, self._rms_height = numbers
        self.has_layers = np.zeros(len(self._radios), dtype=bool)
        """Whether a material has layers in front of its substance, shape [M]."""
        self.has_layers[self._layered] = True

    def reflection(self, material: np.ndarray, cosine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the reflection coefficients TE and TM of a smooth surface, for e^{+jwt}, shape of `material` each.

        Args:
            material: Ids, shape [P].
            cosine: Cosines of incidence, shape [P].
        """
        te, tm = reflection(*self._slabs(material, cosine))
        for rows, found in self._stacks(material, cosine):
            te[rows], tm[rows] = found.r_te, found.r_tm
        return te, tm

    def transmission(self, material: np.ndarray, cosine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the transmission coefficients TE and TM, 0 where nothing comes through, shape of `material` each."""
        te, tm = transmission(*self._slabs(material, cosine))
        for rows, found in self._stacks(material, cosine):
            te[rows], tm[rows] = found.t_te, found.t_tm
        return te, tm

    def _slabs(self, material: np.ndarray, cosine: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the arguments of `mmw.physics.em.fresnel`."""
        return self.permittivity[material], cosine, self._thickness[material], self._carrier_hz[material]

    def specular_share(self, material: np.ndarray, cosine: np.ndarray) -> np.ndarray:
        """Return the share of the reflected amplitude that a mirror keeps, shape of `material`."""
        wave_number = 2.0 * np.pi / SPEED_OF_LIGHT * self._carrier_hz[material]
        given = self._scattering[material], self._rms_height[material], cosine, wave_number
        shape = (len(material),)
        return run_on_host(mirror_share_kernel, shape, given, (), (shape,))[0]

    def diffuse_share(self, material: np.ndarray, cosine: np.ndarray) -> np.ndarray:
        """Return the share S_eff of the reflected amplitude that is scattered, shape of `material`."""
        scattering, height = self._scattering[material], self._rms_height[material]
        if not height.any():
            return scattering
        kept = self.specular_share(material, cosine) ** 2
        return np.where(height > 0.0, np.sqrt(1.0 - kept), scattering)

    def _stacks(self, material: np.ndarray, cosine: np.ndarray) -> list[tuple[np.ndarray, StackCoefficients]]:
        """Return rows and coefficients of each layered material among some."""
        found = []
        for index in self._layered:
            rows = np.nonzero(material == index)[0]
            if len(rows):
                carrier = float(self._carrier_hz[index])
                layers = radio_stack(self._radios[index], complex(self.permittivity[index]), carrier)
                found.append((rows, stack_coefficients(layers, cosine[rows], carrier)))
        return found


@remembered(size=64)
def _radio_numbers(radios: tuple[RadioMaterial, ...]) -> tuple[np.ndarray, list[int]]:
    """Return thickness, scattering coefficient and rms height of each material, [3, M], and those that have layers."""
    rows = [[getattr(radio, name) for radio in radios] for name in ("thickness", "scattering", "rms_height")]
    numbers = np.array(rows, dtype=np.float64)
    numbers.flags.writeable = False
    return numbers, [index for index, radio in enumerate(radios) if radio.layers]


def radio_stack(radio: RadioMaterial, permittivity: complex, carrier_hz: float) -> tuple[StackLayer, ...]:
    """Return the layers of a material at a carrier, its substance last.

    Args:
        radio: The material.
        permittivity: Complex relative permittivity of its substance.
        carrier_hz: Carrier frequency [Hz].

    Raises:
        InputError: If the row of a layer has no permittivity at the carrier.
    """
    values = layer_permittivities(radio, carrier_hz)
    front = [
        StackLayer(value, layer.thickness, layer.sheet_resistance)
        for layer, value in zip(radio.layers, values, strict=True)
    ]
    return (*front, StackLayer(permittivity, radio.thickness))


def material_response(radio: RadioMaterial, carrier_hz: float, used_by: str = "") -> SurfaceResponse:
    """Return the response of one material, whose id is 0.

    Args:
        radio: The material.
        carrier_hz: Carrier frequency [Hz].
        used_by: Name of the material, for error messages.

    Raises:
        InputError: If the material has no permittivity at the carrier.
    """
    return SurfaceResponse([radio], np.array([relative_permittivity(radio, carrier_hz, used_by)]), carrier_hz)
