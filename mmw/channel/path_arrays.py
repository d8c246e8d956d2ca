"""Hold the arrays of the paths between the transmitters and receivers of a scene."""

from dataclasses import dataclass, fields

import numpy as np

from mmw.channel.paths import PATH_KINDS
from mmw.channel.radio_ends import RadioEnds
from mmw.core.constants import SPEED_OF_LIGHT


@dataclass(frozen=True, eq=False, kw_only=True)
class PathArrays:
    """Arrays of P paths in one weather, at C carriers. World frame, meters, seconds, radians, e^{+jwt}."""

    scenario: str
    """Name of the scene."""
    weather: str
    """Weather of the gains."""
    frame: int
    """Frame of the scene."""
    carriers_hz: np.ndarray
    """Carrier frequencies [Hz], shape [C]."""
    transmitters: RadioEnds
    """The transmitters."""
    receivers: RadioEnds
    """The receivers."""
    is_synthetic: bool
    """True if paths lead between phase centers; False if between single elements of the arrays."""
    tx: np.ndarray
    """Transmitter of each path, shape [P], int32."""
    rx: np.ndarray
    """Receiver of each path, shape [P], int32."""
    tx_element: np.ndarray
    """Element of the transmitter's array that a path leaves, 0 for synthetic arrays, shape [P], int32."""
    rx_element: np.ndarray
    """Element of the receiver's array that a path reaches, 0 for synthetic arrays, shape [P], int32."""
    tau: np.ndarray
    """Absolute delay [s], shape [P], float64."""
    a: np.ndarray
    """Coefficient between the elements of the first polarization of both arrays, losses included, without the carrier
    phase, shape [P, C], complex128."""
    transfer: np.ndarray
    """2x2 polarimetric transfer, shape [P, C, 2, 2], complex128: row = receive, column = transmit component in the
    world's (theta, phi) basis at arrival and departure; no antenna pattern, no carrier phase."""
    theta_t: np.ndarray
    """Zenith of departure, shape [P]."""
    phi_t: np.ndarray
    """Azimuth of departure, shape [P]."""
    theta_r: np.ndarray
    """Zenith of arrival: direction from the receiver back along the path, shape [P]."""
    phi_r: np.ndarray
    """Azimuth of arrival, shape [P]."""
    range_rate: np.ndarray
    """Rate of change of the path's length [m/s], positive when it grows, shape [P]."""
    kind_id: np.ndarray
    """Kind of each path, a row of `mmw.channel.paths.PATH_KINDS`, shape [P], int8."""
    depth: np.ndarray
    """Number of interactions, shape [P], int8."""
    interaction_types: np.ndarray
    """Interactions from transmitter to receiver (`mmw.physics.em.interaction`), 0 behind the last, [P, D], int8."""
    vertices: np.ndarray
    """Point of each interaction [m], NaN behind the last, shape [P, D, 3], float64."""
    normals: np.ndarray
    """Unit normal there, toward the incoming wave, NaN behind the last, shape [P, D, 3], float64."""
    edges: np.ndarray
    """Unit vector along the edge that diffracts, NaN for a path without one, shape [P, 3], float64."""
    curvatures: np.ndarray
    """Curvature of the surface that reflects, NaN for flat ones: xx, xy, xz, yy, yz, zz of a symmetric matrix over its
    tangent plane, positive where it bends away [1/m], shape [P, 6], float64."""
    object_ids: np.ndarray
    """Object of each interaction, -1 behind the last, shape [P, D], int32."""
    material_ids: np.ndarray
    """Material of each interaction, -1 behind the last, shape [P, D], int32."""
    surface_ids: np.ndarray
    """Planar surface of each interaction (of a diffraction: its wedge), -1 behind the last, shape [P, D], int32."""
    path_ids: np.ndarray
    """Identifier of a path, the same in every frame, shape [P], int64."""
    rain_db: np.ndarray
    """Loss by rain that `a` and `transfer` hold [dB], shape [P, C]."""
    fog_db: np.ndarray
    """Loss by fog [dB], shape [P, C]."""
    gas_db: np.ndarray
    """Loss by the gases of the air [dB], shape [P, C]."""
    foliage_db: np.ndarray
    """Loss by foliage [dB], shape [P, C]."""

    @property
    def tx_names(self) -> tuple[str, ...]:
        """Names of the transmitters, shape [T]."""
        return self.transmitters.names

    @property
    def rx_names(self) -> tuple[str, ...]:
        """Names of the receivers, shape [R]."""
        return self.receivers.names

    @property
    def tx_positions(self) -> np.ndarray:
        """Phase centers of the transmitters [m], shape [T, 3]."""
        return self.transmitters.state.position

    @property
    def rx_positions(self) -> np.ndarray:
        """Phase centers of the receivers [m], shape [R, 3]."""
        return self.receivers.state.position

    @property
    def kind(self) -> np.ndarray:
        """Kind of each path, `los`, `specular`, `transmission`, `diffuse` or `diffraction`, shape [P]."""
        return np.array(PATH_KINDS)[self.kind_id]

    @property
    def doppler_hz(self) -> np.ndarray:
        """Doppler shift -f / c times the range rate [Hz], shape [P, C]."""
        return -self.range_rate[:, None] * self.carriers_hz / SPEED_OF_LIGHT

    @property
    def gain_db(self) -> np.ndarray:
        """Power gain |a|^2 of each path [dB], -inf in a null of a pattern, shape [P, C]."""
        with np.errstate(divide="ignore"):
            return 20.0 * np.log10(np.abs(self.a))

    @property
    def is_los(self) -> np.ndarray:
        """True for lines of sight, shape [P], bool."""
        return self.kind_id == 0


_NAMES = tuple(field.name for field in fields(PathArrays))
PATH_FIELDS = _NAMES[_NAMES.index("tx") :]
"""Fields of `PathArrays` with one entry a path."""
