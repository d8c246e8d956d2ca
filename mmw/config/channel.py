"""`channel`: the radio links and how their paths are traced. Defaults are the paper's ray-tracing parameters."""

from collections.abc import Sequence
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from mmw.config.agent_keys import AgentIdentity
from mmw.config.antennas import AntennaConfig
from mmw.config.links import LINK_RULES, LinkEnds, LinkName, LinkRule, link_ends
from mmw.config.physics_presets import PHYSICS_PRESETS, Physics
from mmw.config.sampling import Sampling
from mmw.core.errors import InputError

FEWEST_DIFFUSE_RAYS = 2**9
"""Rays for rough surfaces that each end launches at least for a stated error. Design value."""

RAYS_PER_ERROR = 8.0
"""Rays of an end times the squared relative error that they give, measured on town03 and town10 at depth 3."""


class ChannelConfig(Sampling):
    """Paths on every link: line of sight, sequences of specular reflections, and what else is switched on."""

    enabled: bool = Field(default=True, description="trace radio channels at all (true or false)")
    physics: Physics = Field(
        default="paper",
        description="preset of the keys below: `paper` has their defaults, `standard` and `full` compute more (name)",
    )
    carriers_hz: tuple[float, ...] = Field(
        default=(28e9, 4.9e9), description="carrier frequencies, all from one trace [Hz]"
    )
    links: tuple[LinkName | LinkRule, ...] = Field(
        default=("v2i",),
        description="rules of links: names of built-in ones, such as `v2i`, every RSU to every CAV, or `v2v`, every "
        "ordered pair of CAVs; or definitions (list)",
    )
    antennas: tuple[AntennaConfig, ...] = Field(
        default_factory=lambda: (AntennaConfig(),), description="antennas of the agents (list)"
    )
    samples_per_tx: int = Field(
        default=1_000_000,
        ge=1000,
        le=2**24,
        description="rays launched from each transmitter and frame; both ends of a V2V pair share them (count)",
    )
    candidates: Literal["launch", "exhaustive"] = Field(
        default="launch",
        description="how reflecting surfaces are found: by launched rays, or every surface for every link (mode)",
    )
    max_depth: int = Field(default=1, ge=0, le=8, description="most interactions on a path (count)")
    los: bool = Field(default=True, description="the line of sight (true or false)")
    specular_reflection: bool = Field(default=True, description="mirror reflections (true or false)")
    refraction: bool = Field(
        default=False, description="straight through slabs, materials with a thickness, on any leg (true or false)"
    )
    finite_surfaces: bool = Field(
        default=False,
        description="reflections weakened, and reaching beyond the edges, as the size of the surface against the "
        "Fresnel zone demands (true or false)",
    )
    diffraction: bool = Field(default=False, description="around one convex edge of a path, UTD (true or false)")
    edge_diffraction: bool = Field(
        default=False,
        description="with `diffraction`, around free edges of open sheets too, whose faces then have both sides "
        "(true or false)",
    )
    diffraction_min_bend_rad: float = Field(
        default=0.05,
        ge=1e-3,
        le=1.5,
        description="edges with a smaller angle between the normals of their faces do not diffract [rad]",
    )
    diffraction_lit_region: bool = Field(
        default=True, description="diffracted paths also where the source or its reflection is seen (true or false)"
    )
    diffuse_reflection: bool = Field(
        default=False,
        description="scattering at one rough surface, materials with a scattering coefficient (true or false)",
    )
    dynamic_range_db: float | None = Field(
        default=None,
        gt=0,
        description="paths that are weaker than the strongest of their link by more than this, at every carrier and in "
        "every weather, are left out, but for diffuse ones; none by default [dB]",
    )
    diffuse_samples: int = Field(
        default=1000, ge=2, le=2**24, description="rays that look for rough surfaces; each gives a path a link (count)"
    )
    diffuse_error_db: float | None = Field(
        default=None,
        ge=0.1,
        le=3.0,
        description="standard error of the summed power of the diffuse paths of a link, which replaces "
        "`diffuse_samples`: both ends launch as many rays as it needs, at most 2^20; none by default [dB]",
    )
    diffuse_order: int = Field(
        default=1,
        ge=1,
        le=2,
        description="most rough surfaces that scatter on a path; with 2, also one after the other, without mirrors and "
        "slabs (count)",
    )
    foliage: bool = Field(
        default=False,
        description="crowns of trees and hedges, materials with the medium foliage, weaken waves and scatter them "
        "instead of blocking and mirroring them (true or false)",
    )

    @property
    def antenna_names(self) -> tuple[str, ...]:
        """Names of the antennas."""
        return tuple(antenna.name for antenna in self.antennas)

    @property
    def link_rules(self) -> tuple[LinkRule, ...]:
        """Rules of the links, built-in ones as their definitions."""
        return tuple(LINK_RULES[rule] if isinstance(rule, str) else rule for rule in self.links)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the rules."""
        return tuple(rule.name for rule in self.link_rules)

    def link_ends(self, agents: Sequence[AgentIdentity]) -> list[LinkEnds]:
        """Return the links of actors, given by role, name, model and class; see `mmw.config.links.link_ends`."""
        return link_ends(self.link_rules, self.antennas, agents)

    @property
    def diffuse_relative_error(self) -> float | None:
        """Relative standard error of the power of the diffuse paths of a link, 10^(e / 10) - 1; None if not stated."""
        return None if self.diffuse_error_db is None else 10.0 ** (self.diffuse_error_db / 10.0) - 1.0

    @property
    def expected_diffuse_rays(self) -> int:
        """Rays for rough surfaces that an end launches; with a stated error about as many as links in a town need."""
        error = self.diffuse_relative_error
        return self.diffuse_samples if error is None else max(FEWEST_DIFFUSE_RAYS, int(RAYS_PER_ERROR / error**2))

    @property
    def surface_options(self) -> dict[str, Any]:
        """Arguments of `make_surface_table`: which edges diffract, and whether surfaces are finite."""
        return {
            "wedges": self.diffraction,
            "sheets": self.edge_diffraction,
            "min_bend": self.diffraction_min_bend_rad,
            "finite": self.finite_surfaces,
            "foliage": self.foliage,
        }

    @property
    def is_reciprocal(self) -> bool:
        """True if a link and its reverse have one transfer: wedges tell the ends apart, diffuse rays start at one."""
        return not (self.diffraction or self.diffuse_reflection)

    @model_validator(mode="after")
    def _preset_fills_in(self) -> "ChannelConfig":
        for key, value in PHYSICS_PRESETS[self.physics].items():
            is_replaced = key == "diffuse_error_db" and "diffuse_samples" in self.model_fields_set
            if key not in self.model_fields_set and not is_replaced:
                object.__setattr__(self, key, value)  # the section is frozen for all others
        return self

    @model_validator(mode="after")
    def _rays_are_counted_once(self) -> "ChannelConfig":
        default = type(self).model_fields["diffuse_samples"].default
        if self.diffuse_error_db is not None and self.diffuse_samples != default:
            raise InputError(
                f"diffuse_samples = {self.diffuse_samples} and diffuse_error_db = {self.diffuse_error_db:g}: the error "
                "chooses the number of rays; leave one of them out"
            )
        return self

    @field_validator("carriers_hz")
    @classmethod
    def _carriers(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        for carrier in value:
            if not 1e8 <= carrier <= 1e12:
                raise InputError(f"{carrier:g} Hz is outside 1e8 to 1e12 Hz; carriers are in hertz, for example 28.0e9")
        if not value or len(set(value)) != len(value):
            raise InputError(f"{list(value)}: give at least one carrier, each once")
        return value

    @model_validator(mode="after")
    def _names_fit(self) -> "ChannelConfig":
        for key, names in (("antennas", self.antenna_names), ("links", self.link_names)):
            if len(set(names)) != len(names):
                raise InputError(f"{key} are named {', '.join(names)}; give each its own name")
        if not self.antennas:
            raise InputError("antennas is an empty list; leave it out for the default, or give one")
        for rule in self.link_rules:
            for name in (*rule.tx_antennas, *rule.rx_antennas):
                if name not in self.antenna_names:
                    raise InputError(
                        f"links: rule {rule.name!r} names antenna {name!r}; there are {', '.join(self.antenna_names)}; "
                        "name one of them"
                    )
        return self
