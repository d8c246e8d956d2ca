"""One material, described for every sensor: radio, LiDAR and image. Names and numbers come from the USD Material."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import Any, Literal

from mmw.core.errors import InputError
from mmw.physics.materials.appearance import GREY, Appearance
from mmw.physics.materials.itu_rows import PERMITTIVITY, PREFIX, RADIO_ROWS
from mmw.physics.materials.layers import Layer, as_layers, wrong_layers
from mmw.physics.materials.scattering_patterns import (
    LOBES,
    PATTERNS,
    ScatteringFunction,
    check_scattering_pattern,
    function_name,
    scattering_pattern_names,
)

PermittivityFunction = Callable[[float], complex | tuple[float, float]]
"""Frequency [Hz] -> complex relative permittivity eps_r - j sigma / (2 pi f eps_0) for e^{+jwt}, or the pair (relative
permittivity, conductivity [S/m])."""

LOBE_EXPONENTS = ("alpha_r", "alpha_i")
"""Fields of `RadioMaterial` that are exponents."""

MAX_LOBE_EXPONENT = 1000
"""Largest of them: the integral of a lobe has binomials, which leave the range of float64 beyond it."""


@dataclass(frozen=True)
class RadioMaterial:
    """Electromagnetic description of a surface; the permittivity at a carrier follows in
    `mmw.physics.materials.permittivity`.

    Raises:
        InputError: If a value is unknown, out of range or not finite, or if the scattered power of a function does not
            integrate to 1.

    Examples:
        >>> import mmw
        >>> foam = mmw.RadioMaterial("constant", relative_permittivity=1.5, conductivity=1e-4, thickness=0.05)
        >>> scene = mmw.load_scene("town03")
        >>> scene.add_material("foam", foam).name
        'foam'
    """

    model: Literal["itu", "constant", "function"]
    """`itu`: a named row of ITU-R P.2040, of P.527, or of the paper, or `itu_pec`; `constant`: the two numbers below at
    every frequency; `function`: `permittivity` at each frequency."""
    itu: str = ""
    """Row name with its prefix, such as `itu_concrete`; `itu_pec` is the perfect conductor; empty for other models."""
    relative_permittivity: float = 1.0
    """Real part of the relative permittivity, for `constant` [-]."""
    conductivity: float = 0.0
    """Conductivity, for `constant` [S/m]."""
    thickness: float = 0.0
    """Slab thickness [m]; 0 means a half-space, which lets nothing through."""
    scattering: float = 0.0
    """Scattering coefficient S, 0 to 1 [-]."""
    xpd: float = 0.0
    """Cross-polarisation coefficient of scattering, 0 to 1 [-]."""
    scattering_pattern: str | ScatteringFunction = "lambertian"
    """Scattering pattern: `lambertian` cos theta_s around the normal; `directive` a lobe around the reflected
    direction; `backscattering` that lobe and one back to where the wave came from; a name of
    `register_scattering_pattern`; or a function (k_in, k_out, normal) -> density [1/sr] (see
    `mmw.physics.materials.scattering_patterns`)."""
    alpha_r: int = 4
    """Exponent of the lobe around the reflection, 1 to `MAX_LOBE_EXPONENT` [-]; a larger one is narrower."""
    alpha_i: int = 4
    """Exponent of the lobe back to the source, 1 to `MAX_LOBE_EXPONENT` [-]; only `backscattering` has it."""
    lobe_share: float = 1.0
    """Share Lambda of the lobe around the reflection in `backscattering`, 0 to 1 [-].

    Source of the patterns: Degli-Esposti et al., IEEE Trans. Antennas Propag. 55(1), 2007."""
    rms_height: float = 0.0
    """Standard deviation of the surface's height, finer than the mesh [m]; 0 for a smooth surface. It weakens the
    mirror reflection and scatters what it takes, see `mmw.physics.em.surface_response`."""
    layers: tuple[Layer, ...] = ()
    """Layers in front of the substance, outermost first, each a `Layer` or its text form. The substance itself, of
    `thickness`, is the last one: behind it is air, or with thickness 0 it goes on forever."""
    medium: Literal["solid", "foliage"] = "solid"
    """Medium behind the surface: `solid`, or `foliage`, leaves and twigs, which waves pass with `channel.foliage`."""
    permittivity: PermittivityFunction | None = None
    """Complex relative permittivity as a function of the frequency, for `function`. It is called with one carrier at a
    time. No file holds a function: tables name the model alone."""
    frequency_range_hz: tuple[float, float] | None = None
    """Lowest and highest frequency at which `permittivity` holds [Hz], both included; None for any. A carrier outside
    it is an error."""

    def __post_init__(self) -> None:
        if isinstance(self.frequency_range_hz, list):
            object.__setattr__(self, "frequency_range_hz", tuple(self.frequency_range_hz))
        if not wrong_layers(self.layers):
            object.__setattr__(self, "layers", as_layers(self.layers))
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        wrong = wrong_radio_value(values)
        if wrong is not None:
            name, needed = wrong
            raise InputError(f"radio material: {name} = {values[name]!r}; {needed} is needed; correct it")
        if not isinstance(self.scattering_pattern, str):
            check_scattering_pattern(function_name(self.scattering_pattern), self.scattering_pattern)

    @classmethod
    def absorber(cls) -> "RadioMaterial":
        """Return a material that reflects nothing and lets nothing through: a half-space of vacuum.

        Its reflection coefficients are exactly 0, so paths that it would reflect have gain 0. An edge between absorbing
        faces still diffracts, as that of an opaque screen does.
        """
        return cls("constant")

    @property
    def transmits(self) -> bool:
        """True if a wave may go through: behind the substance, after its thickness, is air again."""
        return self.thickness > 0.0

    @property
    def scatters(self) -> bool:
        """True if a part of the reflected power is scattered."""
        return self.scattering > 0.0 or self.rms_height > 0.0

    @property
    def holds_function(self) -> bool:
        """True if the permittivity or the scattering pattern is a function, which no file can hold."""
        return self.permittivity is not None or not isinstance(self.scattering_pattern, str)


FILE_FIELDS = tuple(
    field.name for field in fields(RadioMaterial) if field.name not in ("permittivity", "frequency_range_hz")
)
"""Fields of a `RadioMaterial` that files hold, in the order of their columns."""


def file_values(radio: RadioMaterial) -> dict[str, Any]:
    """Return the values that files hold of a material, by `FILE_FIELDS`.

    A scattering function is `function`, and layers are their text forms.
    """
    values = {name: getattr(radio, name) for name in FILE_FIELDS}
    values["layers"] = [layer.text for layer in radio.layers]
    if not isinstance(radio.scattering_pattern, str):
        values["scattering_pattern"] = "function"
    return values


def wrong_radio_value(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the first field of a `RadioMaterial` that has a wrong value and what it needs, None if all are right.

    Readers of files call it before they make the material, to name the place and the key.

    Args:
        values: Value of every field, or of those in `FILE_FIELDS`: without a function, for which the model `function`
            is wrong.
    """

    def within(name: str, low: float, high: float) -> bool:
        value = values[name]
        return isinstance(value, Real) and math.isfinite(value) and low <= float(value) <= high

    model, pattern, function = values["model"], values["scattering_pattern"], values.get("permittivity")
    models = ("itu", "constant", "function") if "permittivity" in values else ("itu", "constant")
    is_constant, is_function = model == "constant", model == "function"
    row = values["itu"]
    is_row = isinstance(row, str) and row.removeprefix(PREFIX) in PERMITTIVITY
    row_needed = f"one of {', '.join(RADIO_ROWS)}" if row else "a row such as itu_concrete, for model itu,"
    is_exponent = {
        name: isinstance(values[name], Integral) and within(name, 1, MAX_LOBE_EXPONENT) for name in LOBE_EXPONENTS
    }
    is_pattern = callable(pattern) or (isinstance(pattern, str) and (pattern in LOBES or pattern in PATTERNS))
    patterns = "" if is_pattern else ", ".join(scattering_pattern_names())
    layers_needed = wrong_layers(values["layers"])
    rules = (
        ("model", model in models, f"{', '.join(models[:-1])} or {models[-1]}"),
        ("itu", model != "itu" or is_row, row_needed),
        ("relative_permittivity", not is_constant or within("relative_permittivity", 1.0, math.inf), "at least 1"),
        ("conductivity", not is_constant or within("conductivity", 0.0, math.inf), "at least 0 S/m"),
        ("thickness", within("thickness", 0.0, math.inf), "at least 0 m"),
        ("scattering", within("scattering", 0.0, 1.0), "0 to 1"),
        ("xpd", within("xpd", 0.0, 1.0), "0 to 1"),
        ("scattering_pattern", is_pattern, f"one of {patterns}"),
        *((name, is_good, f"a whole number from 1 to {MAX_LOBE_EXPONENT}") for name, is_good in is_exponent.items()),
        ("lobe_share", within("lobe_share", 0.0, 1.0), "0 to 1"),
        ("rms_height", within("rms_height", 0.0, math.inf), "at least 0 m"),
        ("layers", not layers_needed, layers_needed),
        ("medium", values["medium"] in ("solid", "foliage"), "solid or foliage"),
        (
            "permittivity",
            callable(function) if is_function else function is None,
            "a function of the frequency" if is_function else "model function, for a function,",
        ),
        (
            "frequency_range_hz",
            _is_range(values.get("frequency_range_hz"), is_function),
            "(lowest, highest) above 0 Hz, for model function, or None",
        ),
    )
    return next(((name, needed) for name, is_good, needed in rules if not is_good), None)


def _is_range(value: Any, is_function: bool) -> bool:
    """Return whether a value can be the frequency range of a material."""
    if value is None:
        return True
    if not (is_function and isinstance(value, tuple) and len(value) == 2):
        return False
    return all(isinstance(end, Real) and math.isfinite(end) for end in value) and 0.0 < value[0] <= value[1]


@dataclass(frozen=True)
class Material:
    """Material of a surface for every sensor.

    Raises:
        InputError: If the reflectance is below 0 or not finite.
    """

    name: str
    """Name of the USD Material prim."""
    radio: RadioMaterial
    nonvisual_base: str
    """SimReady non-visual base token (`omni:simready:nonvisual:base`), such as `asphalt`; `none` where it is absent."""
    lidar_reflectance: float
    """Diffuse reflectance at 905 nm, 0 to 1 [-]."""
    color: tuple[float, float, float]
    """Linear diffuse color, 0 to 1 [-]."""
    coating: str = "none"
    """SimReady coating token: none, paint, clearcoat or paint_clearcoat."""
    is_retroreflective: bool = False
    """True if the surface is retroreflective."""
    appearance: Appearance = GREY
    """Appearance to the RGB camera."""
    radar_radio: RadioMaterial | None = None
    """Radio description that radars see, where the preset of the channel has another one; None for `radio`."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.lidar_reflectance < math.inf:  # that of a retroreflector may be above 1
            raise InputError(
                f"material {self.name!r}: lidar_reflectance = {self.lidar_reflectance:g}; a finite number from 0 on is "
                "needed; correct it"
            )

    @property
    def seen_by_radar(self) -> RadioMaterial:
        """Radio description that radars see."""
        return self.radio if self.radar_radio is None else self.radar_radio


LIDAR_REFLECTANCE_905NM = {
    "asphalt": 0.17, "concrete": 0.37, "brick": 0.38, "stone": 0.45, "marble": 0.55, "clear_glass": 0.08,
    "one_way_mirror": 0.12, "mirror": 0.10, "leaf_grass": 0.50, "dead_leaf_grass": 0.35, "soil": 0.25, "dirt": 0.25,
    "mud": 0.15, "gravel": 0.30, "wood": 0.45, "bark": 0.35, "plastic": 0.40, "plexiglass": 0.15, "rubber": 0.05,
    "aluminum": 0.60, "steel": 0.55, "oxidized_steel": 0.30, "iron": 0.35, "fiberglass": 0.45, "retroreflective": 0.95,
    "none": 0.30,
}  # fmt: skip
"""Diffuse reflectance at 905 nm by non-visual base token: typical laboratory values of spectral libraries (ECOSTRESS
class means, rounded to 0.05 where classes scatter more); design values where a class has no entry."""

PAINT_REFLECTANCE_905NM = (0.05, 0.80)
"""Diffuse reflectance at 905 nm of the blackest and of the whitest paint: carbon black absorbs in the near infrared as
in the visible, titanium dioxide scatters in both. Design values."""


def lidar_reflectance(
    base: str, coating: str = "none", attributes: Sequence[str] = (), color: Sequence[float] = (0.5, 0.5, 0.5)
) -> float:
    """Return the diffuse reflectance at 905 nm of a material, from its SimReady non-visual tokens and its color.

    A painted surface (coating `paint` or `paint_clearcoat`) hides its base: the value runs linearly between the two of
    `PAINT_REFLECTANCE_905NM` with the brightest color channel. The brightest, not the luminance, because colored
    organic pigments let the near infrared through to the white below while black does not; so red and blue cars return
    more than black ones. A `retroreflective` attribute overrides both.

    Args:
        base: Token of `omni:simready:nonvisual:base`.
        coating: Token of `omni:simready:nonvisual:coating`: none, paint, clearcoat or paint_clearcoat.
        attributes: Tokens of `omni:simready:nonvisual:attributes`.
        color: Linear diffuse color, 0 to 1 [-], shape [3].

    Returns:
        Reflectance, 0 to 1 [-].

    Raises:
        InputError: If the base token has no row in `LIDAR_REFLECTANCE_905NM`.
    """
    if base not in LIDAR_REFLECTANCE_905NM:
        known = ", ".join(sorted(LIDAR_REFLECTANCE_905NM))
        raise InputError(
            f"omni:simready:nonvisual:base = {base!r}; needed is one of {known}; use one of them, or `none`"
        )
    if "retroreflective" in attributes:
        return LIDAR_REFLECTANCE_905NM["retroreflective"]
    if coating in ("paint", "paint_clearcoat"):
        black, white = PAINT_REFLECTANCE_905NM
        return black + (white - black) * min(max(*color, 0.0), 1.0)
    return LIDAR_REFLECTANCE_905NM[base]


POROUS_BASES = frozenset(
    {"asphalt", "concrete", "brick", "stone", "soil", "dirt", "mud", "gravel", "wood", "bark"}
)  # fmt: skip
"""Non-visual bases that soak up water and darken. Polished marble, glass, metal, plastic and rubber have no open pores,
and the wax of leaves sheds water. Design choice, after what Angstrom (1925) and Lekner and Dorf (1988) observed."""

WATER_INDEX = 1.33
"""Refractive index of water from the visible to 1550 nm [-]; Hale and Querry 1973 give 1.333, 1.328 and 1.318."""

WATER_ABSORPTION_1_M = {905: 7.0, 1550: 1090.0}
"""Absorption coefficient of liquid water by wavelength [nm], [1/m]: 4 pi k / wavelength with Segelstein's k of 1981."""

WATER_FILM_M = 0.5e-3
"""Water over the grains of a soaked, drained surface [m]: half of the mean texture depth of 1 mm that road asphalt has.
Design value; it takes 0.7 % of the light at 905 nm, and two thirds at 1550 nm."""


def wet_reflectance(material: Material, wetness: float, wavelength_nm: int) -> float:
    """Return the diffuse reflectance of a material when it is wet, 0 to 1 [-].

    A soaked porous surface loses light that the film of water reflects back into it: rho_wet = rho / (n^2 (1 - rho) +
    rho), and what the film absorbs in both directions. The share `wetness` of the surface is soaked, the rest is dry.
    Paint and coatings close the pores and retroreflectors work behind a cover, so both stay as they are, as does
    everything that is not in `POROUS_BASES`.

    The dry reflectance is that of 905 nm at 1550 nm too: most dry minerals and paints differ by less between the two
    than within their class. Leaves, which hold water, are darker there; that is neglected.

    Args:
        material: The dry material.
        wetness: Water in its pores, 0 dry to 1 soaked (`Weather.wetness`).
        wavelength_nm: 905 or 1550 [nm].

    Source: A. Angstrom, "The albedo of various surfaces of ground", Geografiska Annaler 7, 1925; in this form in
    J. Lekner and M. Dorf, "Why some things are darker when wet", Applied Optics 27(7), 1988. Absorption: Beer's law.
    """
    dry = material.lidar_reflectance
    if material.nonvisual_base not in POROUS_BASES or material.coating != "none" or material.is_retroreflective:
        return dry
    film = math.exp(-2.0 * WATER_ABSORPTION_1_M[wavelength_nm] * WATER_FILM_M)
    soaked = dry / (WATER_INDEX**2 * (1.0 - dry) + dry) * film
    return dry + wetness * (soaked - dry)
