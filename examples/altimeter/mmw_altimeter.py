"""Radar altimeter: height of an agent above the first surface below it."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from pydantic import Field

from mmw.scene.ray_casting import cast_rays
from mmw.sensors import (
    F32,
    I32,
    Estimate,
    Modality,
    Samples,
    SensorConfig,
    SensorInput,
    SensorSpec,
    column,
    sensor_table,
)


class Altimeter(SensorConfig):
    """A radar altimeter that looks straight down."""

    type: Literal["altimeter"] = "altimeter"
    name: str = Field("altimeter", description="sensor name (name)")
    on: tuple[Literal["cav", "rsu"], ...] = Field(("cav",), description="agents that carry it (list)")
    range_m: float = Field(120.0, gt=0, description="largest height that is measured [m]")
    noise_m: float = Field(0.02, ge=0, description="standard deviation of the height [m]")


@dataclass(frozen=True)
class AltimeterSamples(Samples):
    """Heights of A views, or of one: `view(index)` of `Samples` takes element `index` of every array."""

    height: np.ndarray
    """Height above the surface below, with noise [m], NaN beyond the range, shape [A], float32."""
    object_id: np.ndarray
    """Object below, a row of `objects`, -1 for none, shape [A], int32."""


def simulate(data: SensorInput, config: Altimeter) -> dict[str, AltimeterSamples]:
    """Cast one ray down from every view; the weather changes nothing."""
    down = np.tile((0.0, 0.0, -1.0), (len(data.views), 1))
    origins = data.views.pose[:, :3]
    hits = cast_rays(data.scene, origins, down, batch_index=data.views.batch_index, max_distance=config.range_m)
    height = hits.distance + config.noise_m * data.normal(config.name)[:, 0]
    height = np.where(np.isfinite(hits.distance), height, np.nan).astype(np.float32)
    return dict.fromkeys(data.weathers, AltimeterSamples(height, hits.object_id))


def to_tables(data: SensorInput, config: Altimeter, samples: AltimeterSamples) -> dict[str, dict[str, Any]]:
    """Return the columns of table `altimeter`; frame, agent and sensor are filled in."""
    height = pa.array(samples.height, mask=np.isnan(samples.height))  # tables have null, never NaN
    return {"altimeter": {"height": height, "object_id": samples.object_id}}


SPEC = SensorSpec(
    type="altimeter",
    title="Radar altimeter",
    kind="scalar",
    config=Altimeter,
    tables=(
        sensor_table(
            "altimeter",
            "One altimeter sample.",
            column("height", F32, "m", "height above the first surface below, null beyond the range", nullable=True),
            column("object_id", I32, "id", "object below, a row of `objects`; -1 for none"),
        ),
    ),
    simulate="mmw_altimeter:simulate",
    to_tables="mmw_altimeter:to_tables",
    estimate=lambda config: Estimate(rays=1, bytes=24.0),
    window=Modality("altimeter", "numbers", ("height",)),
)
