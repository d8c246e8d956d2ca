"""`type: radar`: an automotive radar at 77 GHz."""

from typing import Literal

from pydantic import Field

from mmw.config.section import Name
from mmw.config.sensor import MountConfig, Role, SensorSection


class RadarConfig(SensorSection):
    """A radar that looks along its x axis."""

    type: Literal["radar"] = "radar"
    name: Name = Field("radar", description="sensor name (name)")
    on: tuple[Role, ...] = Field(("rsu",), description="agents that carry it (list)")
    mount: dict[Role, MountConfig] = Field(
        default_factory=lambda: {
            "rsu": MountConfig(position_m=(0, 0, 4.1)),
            "cav": MountConfig(position_m=(2.5, 0, 0.6)),
        },
        description="mount for each role; a role that is left out keeps its default (map)",
    )
    mode: Literal["compat", "physical"] = Field("physical", description="CARLA's radar, or a link budget (name)")
    horizontal_fov_deg: float = Field(110.0, gt=0, lt=180, description="horizontal field of view [deg]")
    vertical_fov_deg: float = Field(30.0, gt=0, lt=180, description="vertical field of view [deg]")
    range_m: float = Field(100.0, gt=0, le=1000, description="longest range [m]")
    points: int = Field(2000, ge=1, le=1_000_000, description="rays of a sample in `compat` (count)")
