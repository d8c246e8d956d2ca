"""`type: gnss`: a satellite navigation receiver."""

from typing import Literal

from pydantic import Field

from mmw.config.section import Name
from mmw.config.sensor import Role, SensorSection


class GnssConfig(SensorSection):
    """A satellite navigation receiver: position, velocity and heading with noise."""

    type: Literal["gnss"] = "gnss"
    name: Name = Field("gnss", description="sensor name (name)")
    on: tuple[Role, ...] = Field(("cav",), description="agents that carry it (list)")
