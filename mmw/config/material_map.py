"""Material maps: pattern -> what a surface is, to override what a world says or to say what it leaves out."""

from collections.abc import Mapping
from typing import Any

from pydantic import ConfigDict, Field, field_validator, model_validator

from mmw.config.section import Name, Section, Vec3
from mmw.core.errors import InputError
from mmw.physics.materials.layers import parse_layer


def _or_name(schema: dict[str, Any]) -> None:
    """Add the short form of an entry to its JSON Schema."""
    body = dict(schema)
    schema.clear()
    schema["anyOf"] = [{"type": "string"}, body]


class MaterialChanges(Section):
    """Properties that a material gets; text instead is the name of a radio material."""

    model_config = ConfigDict(json_schema_extra=_or_name)

    radio: str | None = Field(default=None, description="radio material, such as itu_brick or itu_pec (name)")
    relative_permittivity: float | None = Field(
        default=None, ge=1, description="real part, the same at every frequency, instead of `radio` (ratio)"
    )
    conductivity: float | None = Field(default=None, ge=0, description="goes with `relative_permittivity` [S/m]")
    thickness: float | None = Field(default=None, ge=0, description="of a slab; 0 for a half-space [m]")
    scattering: float | None = Field(default=None, ge=0, le=1, description="scattering coefficient S (fraction)")
    xpd: float | None = Field(
        default=None, ge=0, le=1, description="cross-polarised share of the scattered power (fraction)"
    )
    scattering_pattern: str | None = Field(
        default=None, description="lambertian, directive, backscattering or a registered pattern (name)"
    )
    alpha_r: int | None = Field(
        default=None, ge=1, le=1000, description="exponent of the lobe around the reflection (number)"
    )
    alpha_i: int | None = Field(
        default=None, ge=1, le=1000, description="exponent of the lobe back to the source (number)"
    )
    lobe_share: float | None = Field(
        default=None, ge=0, le=1, description="share of the lobe around the reflection in backscattering (fraction)"
    )
    rms_height: float | None = Field(
        default=None, ge=0, description="standard deviation of the surface's height, 0 for a smooth one [m]"
    )
    layers: tuple[str, ...] | None = Field(
        default=None,
        description="layers in front of the substance, outermost first: `itu_glass 0.004` (row, m), `constant 2.5 "
        "0.001 0.01` (relative permittivity, S/m, m) or `sheet 5` (ohm/square) (list)",
    )
    base: str | None = Field(
        default=None, description="SimReady non-visual base, such as brick: LiDAR, radar roughness, pores (token)"
    )
    lidar_reflectance: float | None = Field(
        default=None,
        ge=0,
        le=1,
        description="diffuse reflectance at 905 nm, dry; that of the base if absent (fraction)",
    )
    color: Vec3 | None = Field(default=None, description="linear diffuse color, 0 to 1 (fraction)")
    roughness: float | None = Field(default=None, ge=0, le=1, description="roughness of the picture (fraction)")
    metallic: float | None = Field(default=None, ge=0, le=1, description="0 dielectric, 1 bare metal (fraction)")
    opacity: float | None = Field(default=None, ge=0, le=1, description="1 for opaque (fraction)")

    @property
    def changes(self) -> dict[str, object]:
        """Properties that are given."""
        return self.model_dump(exclude_none=True, include=set(MaterialChanges.model_fields))

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, value: Any) -> Any:
        if isinstance(value, str):
            return {"radio": value}
        if isinstance(value, dict):
            # A validator that runs first leaves JSON behind, and strict Python takes no list for a tuple.
            lists = {key: tuple(value[key]) for key in ("color", "layers") if isinstance(value.get(key), list)}
            return {**value, **lists}
        return value

    @field_validator("layers")
    @classmethod
    def _layers(cls, value: tuple[str, ...] | None) -> tuple[str, ...] | None:
        for text in value or ():
            parse_layer(text)
        return value

    @model_validator(mode="after")
    def _one_substance(self) -> "MaterialChanges":
        if self.radio is not None and self.relative_permittivity is not None:
            raise InputError("`radio` and `relative_permittivity` are both given; keep one")
        if self.conductivity is not None and self.relative_permittivity is None:
            raise InputError("`conductivity` needs `relative_permittivity`; add it")
        if self.color is not None and not all(0.0 <= value <= 1.0 for value in self.color):
            raise InputError(f"color = {list(self.color)}; three numbers from 0 to 1 are needed")
        if not self.model_dump(exclude_none=True, exclude_defaults=True):
            raise InputError("says nothing; give material, radio or label")
        return self


class MaterialEntry(MaterialChanges):
    """Material of the meshes that a pattern matches; text instead is the name of a radio material."""

    material: str | None = Field(
        default=None, description="material of the library: radio, LiDAR and look (material name)"
    )
    label: str | None = Field(default=None, description="semantic class that the meshes get (label)")
    weathers: dict[Name, MaterialChanges] = Field(
        default_factory=dict, description="weather -> what differs in it, over everything else (map)"
    )

    @property
    def changes_material(self) -> bool:
        """True if the entry says more than a class."""
        return bool(self.material is not None or self.weathers or self.changes)

    @property
    def names_radio(self) -> bool:
        """True if the entry says by itself what the material is to radio waves."""
        return any(value is not None for value in (self.material, self.radio, self.relative_permittivity))

    @model_validator(mode="after")
    def _one_material(self) -> "MaterialEntry":
        if self.material is not None and self.changes:
            raise InputError(
                f"`material` = {self.material!r} brings all properties; remove {', '.join(self.changes)}, or name "
                "`radio` instead of it"
            )
        return self


def merged_maps(*maps: Mapping[str, MaterialEntry]) -> dict[str, MaterialEntry]:
    """Return several material maps as one, in which entries of earlier maps come first; each pattern counts once."""
    result: dict[str, MaterialEntry] = {}
    for entries in maps:
        result.update((pattern, entry) for pattern, entry in entries.items() if pattern not in result)
    return result
