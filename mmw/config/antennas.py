"""`channel.antennas`: the antennas of the agents, each with a mount, a pattern, a polarization and an array."""

from typing import Literal

from pydantic import Field

from mmw.config.agent_keys import AGENT_ROLES, ROLE_MOUNTS, AgentKey
from mmw.config.section import Name
from mmw.config.sensor import ON_ROOF, MountConfig, Mounted, mounts_at


class AntennaConfig(Mounted):
    """One antenna, or array of equal antennas, of an agent. Links are between the phase centers of antennas.

    Stored coefficients are those of single elements of the first polarization; `mmw.channel.apply_arrays` makes the
    coefficients of all elements from them.
    """

    name: Name = Field(
        default="antenna", description="unique among antennas and sensors; `antenna` and `peer_antenna` of rows (name)"
    )
    on: tuple[AgentKey, ...] = Field(
        default=AGENT_ROLES, description="agents that carry it, as `on` of sensors; all by default (list)"
    )
    mount: dict[AgentKey, MountConfig] = mounts_at(ON_ROOF, **ROLE_MOUNTS)
    pattern: Literal["dipole", "iso", "hw_dipole", "tr38901"] = Field(
        default="dipole",
        description="element pattern; `tr38901` is a sector that looks along the mount's x, 65 degrees wide (name)",
    )
    polarization: Literal["V", "H", "VH", "cross"] = Field(
        default="V", description="polarization of each element; `cross` is -45 and +45 degrees (name)"
    )
    num_rows: int = Field(default=1, ge=1, le=4096, description="elements in a column, along the mount's z (count)")
    num_cols: int = Field(default=1, ge=1, le=4096, description="elements in a row, along the mount's y (count)")
    vertical_spacing: float = Field(
        default=0.5, gt=0, le=1000, description="distance between rows, in wavelengths of each carrier [wavelengths]"
    )
    horizontal_spacing: float = Field(
        default=0.5, gt=0, le=1000, description="distance between columns, in wavelengths of each carrier [wavelengths]"
    )
    power_dbm: float = Field(
        default=44.0,
        ge=-200,
        le=200,
        description="transmit power; coefficients and gains of links are without it, radio maps with it [dBm]",
    )
