"""Describe a kind of sensor in one object, which all code that handles sensors queries."""

import builtins
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from mmw.config.sensor import SensorConfig
from mmw.core.errors import InputError
from mmw.core.registry import Registry

if TYPE_CHECKING:
    from mmw.config.lens import LensConfig
    from mmw.core.camera_models import Intrinsics
    from mmw.storage.table_spec import TableSpec

Reference = str
"""`module:attribute`; imported when it is first used, so that reading a configuration loads neither Warp nor USD."""


VIEWS = ("plot", "figure", "viewer")
"""Names of the drawing functions of a sensor, see `SensorSpec.views`."""


@dataclass(frozen=True)
class Estimate:
    """Cost of one sample, for `--dry-run`."""

    rays: float = 0
    """Rays that are traced [count]."""
    bytes: float = 0.0
    """Size in the tables [bytes]."""
    bytes_per_box: float = 0.0
    """Further size for each vehicle or pedestrian of the scenario [bytes]."""


@dataclass(frozen=True)
class Camera:
    """Projection of a camera."""

    intrinsics: "Intrinsics"
    lens: "LensConfig"
    range_m: float
    """Longest depth [m]."""


@dataclass(frozen=True)
class Modality:
    """One kind of array in a window of samples for learning."""

    table: str
    """Table that it is read from."""
    kind: Literal["numbers", "points", "rgb", "depth", "beams", "csi", "boxes"]
    columns: tuple[str, ...] = ()
    """Default columns, in the order of the array's last axis."""
    dtype: Literal["float32", "float64"] = "float32"
    """Type of `numbers`."""


@dataclass(frozen=True)
class SensorSpec:
    """One kind of sensor: its configuration, its tables, and how it is simulated.

    `simulate` gives the samples of one sensor as arrays. A run calls it and makes rows of them by `to_tables`; where
    several sensors share their rays, or rows are made by threads, it calls `capture` or `start` instead.
    """

    type: str
    """`type:` of the configuration, and the name of the primary table."""
    title: str
    """Name for people, such as `LiDAR`."""
    kind: Literal["points", "image", "scalar", "signal"]
    """Shape of a sample, by which viewers and exporters choose what they can show or carry."""
    config: "builtins.type[SensorConfig]"
    """Section of the configuration."""
    tables: "tuple[TableSpec, ...]"
    """Tables that the sensor fills, the primary one first. Sensors that fill one table name the same object."""
    simulate: Reference = ""
    """`(SensorInput, config) -> {weather: samples}`. Samples are a dataclass of arrays over the views of the input,
    with a method `view(index)` that gives one view's (`mmw.sensors.Samples`); others are handed on whole."""
    to_tables: Reference = ""
    """`(SensorInput, config, samples) -> {table: columns}`; frame, agent and sensor are filled in."""
    capture: Reference = ""
    """`(Batch, sensors, frames, collected)`, which adds the rows of sensors; kinds that name the same function are
    captured in one call, with the functions that `simulate` calls."""
    start: Reference = ""
    """The same as a context manager, in place of `capture`: the device starts at its beginning, the rows are added at
    its end, and everything else is traced in between."""
    warp_output: bool = False
    """True if `simulate` leaves arrays on the device where `SensorInput.output` says so."""
    shared_tables: tuple[str, ...] = ()
    """Tables of other parts of mmw that the sensor adds rows to, such as `box_visibility`."""
    rows_per_sample: Callable[[Any], Mapping[str, int]] | None = None
    """`config -> {table: rows of each sample}`; one row of the primary table if absent."""
    variable_rows: Callable[[Any], tuple[str, ...]] = field(default=lambda config: ())
    """`config -> tables` of the sensor in which a sample has any number of rows, or none."""
    estimate: Callable[[Any], Estimate] = field(default=lambda config: Estimate())
    """`config -> Estimate`."""
    defaults: Callable[[], tuple[SensorConfig, ...]] = tuple
    """Sensors of this kind in a configuration that lists none."""
    kernels: Callable[[Any, bool], Mapping[str, float]] = field(default=lambda config, on_gpu: {})
    """`(config, on_gpu) -> {module of mmw.kernels: seconds that a CPU takes to compile it}`: those every run needs."""
    camera: Callable[[Any], Camera] | None = None
    """`config -> Camera`: gives the sensor a USD Camera prim and lens columns in table `sensors`."""
    sweep_s: Callable[[Any], float] = field(default=lambda config: 0.0)
    """`config -> time before the frame in which rays start [s]`."""
    needs_clear_view: bool = False
    """True if its mount must not be inside a body."""
    needs_appearance: bool = False
    """True if it shows the appearance of surfaces in visible light."""
    warm_up: Reference = ""
    """`(Config)`: slow work that a thread begins while the first scene is read."""
    decode: Reference = ""
    """`(Agent, name of the sensor) -> sample` for `mmw.dataset`; by `kind` if absent, see `Agent.sensor`."""
    window: Modality | None = None
    """Modality of learning windows; of a scalar sensor its columns are those drawn over time."""
    views: Mapping[Literal["plot", "figure", "viewer"], Reference] = field(default_factory=dict)
    """Drawing functions; the kind of the sensor decides where one is absent.

    `plot`: `(axes, Agent, name of the sensor, SampleStyle) -> SamplePlot` draws one sample, in figures and reports
    (`mmw.viz.plots.samples`). `figure`: `(Dataset, scenario, weathers, frame, agent, sensor, figure=) -> Figure`
    compares weathers (`mmw.viz.plots.weather_comparison`). `viewer`: `(FrameLogger, Agent, name of the sensor)` logs
    one sample to Rerun (`mmw.viz.rerun.samples`).
    """

    def __post_init__(self) -> None:
        """Check that a run has exactly one way to the rows of the sensor, and that its views are known.

        Raises:
            InputError: If there is none, or there are two, or a view has another name.
        """
        if unknown := sorted(set(self.views) - set(VIEWS)):
            raise InputError(f"sensor {self.type!r}: view {unknown[0]!r} is not known; name one of {', '.join(VIEWS)}")
        if not self.simulate or sum(map(bool, (self.to_tables, self.capture, self.start))) != 1:
            raise InputError(f"sensor {self.type!r}: give `simulate`, and one of `to_tables`, `capture` and `start`")

    def tables_of(self, config: SensorConfig) -> dict[str, int]:
        """Return the tables with a fixed number of rows for each sample of a sensor, and that number."""
        counts = self.rows_per_sample(config) if self.rows_per_sample else {self.tables[0].name: 1}
        return {table: count for table, count in counts.items() if count}


SENSORS: Registry[SensorSpec] = Registry(
    "mmw.sensors",
    "sensor",
    "mmw.config.sensor_spec:SensorSpec",
    {name: f"mmw.sensors.{name}.spec:SPEC" for name in ("lidar", "depth", "imu", "gnss", "radar", "rgb")},
)
"""Kinds of sensors by `type`. Other packages add theirs by the entry point group `mmw.sensors`."""


def spec_of(sensor: SensorConfig) -> SensorSpec:
    """Return the kind of a configured sensor."""
    return SENSORS[sensor.type]


def types_that_fill(table: str) -> tuple[str, ...]:
    """Return the kinds of sensors that add rows to a table; none for tables that sensors do not fill."""
    return tuple(
        name
        for name, spec in SENSORS.items()
        if table in spec.shared_tables or any(own.name == table for own in spec.tables)
    )


def register_sensor(spec: SensorSpec) -> SensorSpec:
    """Register a kind of sensor in this process, for notebooks and tests; packages use an entry point.

    Worker processes import the packages' entry points and do not see it. A run that uses it has one worker, therefore;
    several (`compute.workers`, `compute.engine: ray`) are an error.

    Raises:
        InputError: If its type is taken.
    """
    return SENSORS.register(spec.type, spec)
