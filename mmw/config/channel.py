"""`channel`: the radio links and how their paths are traced. Defaults are the paper's ray-tracing parameters."""

from typing import Literal

from pydantic import Field, field_validator

from mmw.config.agent_keys import AgentKey, of_agent
from mmw.config.sampling import Sampling
from mmw.config.section import Vec3
from mmw.core.errors import InputError


class ChannelConfig(Sampling):
    """Paths on every link: line of sight, sequences of specular reflections, and what else is switched on."""

    enabled: bool = Field(default=True, description="trace radio channels at all (true or false)")
    carriers_hz: tuple[float, ...] = Field(
        default=(28e9, 4.9e9), description="carrier frequencies, all from one trace [Hz]"
    )
    links: tuple[Literal["v2i", "v2v"], ...] = Field(
        default=("v2i",),
        description="`v2i`: every RSU to every CAV (downlink); `v2v`: every ordered pair of CAVs (list)",
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
    diffraction: bool = Field(default=False, description="around one convex edge of a path, UTD (true or false)")
    diffraction_lit_region: bool = Field(
        default=True, description="diffracted paths also where the source or its reflection is seen (true or false)"
    )
    diffuse_reflection: bool = Field(
        default=False,
        description="scattering at one rough surface, materials with a scattering coefficient (true or false)",
    )
    diffuse_samples: int = Field(
        default=1000, ge=2, le=2**24, description="rays that look for rough surfaces; each gives a path a link (count)"
    )
    pattern: Literal["dipole", "iso", "hw_dipole", "tr38901"] = Field(
        default="dipole", description="element pattern of both ends; tr38901 looks along the agent's x (name)"
    )
    polarization: Literal["V", "H"] = Field(default="V", description="polarization of both ends (name)")
    antenna_position_m: dict[AgentKey, Vec3] = Field(
        default_factory=lambda: {"cav": (0.0, 0.0, 2.5), "rsu": (0.0, 0.0, 4.0)},
        description="role, or name of an agent -> antenna in its frame, x forward, y left, z up; the LiDAR's place by "
        "default, also for a role that is left out [m]",
    )

    def antenna_on(self, role: str, name: str) -> Vec3:
        """Return the antenna's place on an agent, by its name or else its role [m]; its origin for other actors."""
        return of_agent(self.antenna_position_m, role, name, (0.0, 0.0, 0.0))

    @property
    def antenna_names(self) -> tuple[str, ...]:
        """Names of the antennas."""
        return ("antenna",)

    @property
    def is_reciprocal(self) -> bool:
        """True if a link and its reverse have one transfer: wedges tell the ends apart, diffuse rays start at one."""
        return not (self.diffraction or self.diffuse_reflection)

    @field_validator("antenna_position_m")
    @classmethod
    def _every_role(cls, value: dict[str, Vec3]) -> dict[str, Vec3]:
        return {**cls.model_fields["antenna_position_m"].get_default(call_default_factory=True), **value}

    @field_validator("carriers_hz")
    @classmethod
    def _carriers(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        for carrier in value:
            if not 1e8 <= carrier <= 1e12:
                raise InputError(f"{carrier:g} Hz is outside 1e8 to 1e12 Hz; carriers are in hertz, for example 28.0e9")
        if not value or len(set(value)) != len(value):
            raise InputError(f"{list(value)}: give at least one carrier, each once")
        return value
