"""Hold a radio map: path gain, RSS, SINR and association of its cells, their distribution, and positions in them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.radio_map.cell_points import find_cells, sample_in_cells
from mmw.channel.radio_map.measurement_surface import MeasurementSurface
from mmw.channel.radio_map.table import radio_map_table
from mmw.channel.radio_map.transmitters import Transmitters
from mmw.config import ChannelConfig
from mmw.core.errors import InputError
from mmw.core.extras import needed_by
from mmw.core.registry import load_reference

if TYPE_CHECKING:
    import pyarrow as pa

BOLTZMANN = 1.380_649e-23
"""Boltzmann constant [J/K], exact (SI of 2019)."""

MAX_POINTS = 10_000
"""Maximum number of points of a cell."""

METRICS = {"path_gain": "path_gain_db", "rss": "rss_dbm", "sinr": "sinr_db"}
"""Metric -> property of a `RadioMap` that has it, in decibel."""


@dataclass(frozen=True)
class RadioMapConfig:
    """Settings of the computation of a map."""

    channel: ChannelConfig
    """Settings of the paths; the map is at its first carrier."""
    points_per_cell: int = 1
    """Points of each cell that the mean is taken over, the square of a whole number; 1 is the middle."""
    bandwidth_hz: float = 1e6
    """Bandwidth of the noise [Hz]. Source of this default and the next: Sionna RT 2.2."""
    temperature_k: float = 293.0
    """Temperature of the noise [K]."""

    def __post_init__(self) -> None:
        first = self.channel.model_copy(update={"carriers_hz": self.channel.carriers_hz[:1]})
        object.__setattr__(self, "channel", first)

    @property
    def carrier_hz(self) -> float:
        """Carrier frequency [Hz]."""
        return self.channel.carriers_hz[0]

    def check(self) -> None:
        """Check the numbers.

        Raises:
            InputError: If one is out of range or not whole.
        """
        check_points(self.points_per_cell)
        for name in ("bandwidth_hz", "temperature_k"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(
                    f"radio map: {name} = {getattr(self, name):g}; it must be above 0; give a positive number"
                )


def check_points(count: int) -> None:
    """Raise InputError if cells cannot have so many points: it is no square of a whole number, or too many."""
    is_whole = isinstance(count, int | np.integer) and 1 <= count <= MAX_POINTS
    if not is_whole or round(count**0.5) ** 2 != count:
        raise InputError(
            f"radio map: points_per_cell = {count!r}; the square of a whole number is needed, 1 to {MAX_POINTS}, such "
            "as 4; correct it"
        )


def at_carrier(channel: ChannelConfig, carrier_hz: float) -> ChannelConfig:
    """Return the settings at one carrier.

    Raises:
        InputError: If it is no carrier.
    """
    try:
        return ChannelConfig(**{**channel.model_dump(), "carriers_hz": (carrier_hz,)})
    except InputError as error:
        raise InputError(f"radio map: carrier_hz = {carrier_hz:g}; {error}") from None


@dataclass(frozen=True, eq=False)
class RadioMap:
    """A finished map: T transmitters, C cells.

    Metrics are named `path_gain` [dB], `rss` [dBm] and `sinr` [dB].

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> transmitter = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
        >>> solver = mmw.RadioMapSolver(max_depth=1, samples_per_tx=100_000)
        >>> radio_map = solver(scene, center_m=(0.0, 0.0), size_m=(80.0, 80.0), cell_size_m=4.0)
        >>> radio_map.as_grid(radio_map.tx_association).shape
        (20, 20)
        >>> places = radio_map.sample_positions(5, min_value_db=-80.0, seed=1)
        >>> places.shape
        (5, 3)
    """

    transmitters: Transmitters
    surface: MeasurementSurface
    config: RadioMapConfig
    path_gain: np.ndarray
    """Mean power gain to an ideal isotropic receiver, transmit pattern and precoding included, shape [T, C], float64;
    exactly 0 where no path of the transmitter arrives."""

    def __repr__(self) -> str:
        return (
            f"<radio map of {', '.join(self.tx_names)} in {len(self.surface):,} cells at "
            f"{self.config.carrier_hz / 1e9:g} GHz, depth {self.config.channel.max_depth}>"
        )

    @property
    def tx_names(self) -> tuple[str, ...]:
        """Names of the transmitters, T of them."""
        return self.transmitters.names

    @property
    def cell_centers(self) -> np.ndarray:
        """Middle of each cell, world frame [m], shape [C, 3], float64."""
        return self.surface.center

    @property
    def cell_areas(self) -> np.ndarray:
        """Area of each cell [m^2], shape [C], float64."""
        return self.surface.area

    @property
    def path_gain_db(self) -> np.ndarray:
        """Path gain [dB], shape [T, C]; -inf where nothing arrives."""
        return _db(self.path_gain)

    @property
    def received_w(self) -> np.ndarray:
        """Received power [W], shape [T, C]; 0 where nothing arrives."""
        return self.path_gain * 10.0 ** ((np.asarray(self.transmitters.power_dbm) - 30.0) / 10.0)[:, None]

    @property
    def rss_dbm(self) -> np.ndarray:
        """Received signal strength [dBm], shape [T, C]; -inf where nothing arrives."""
        return _db(self.received_w) + 30.0

    @property
    def noise_w(self) -> float:
        """Thermal noise k_B T B [W]."""
        return BOLTZMANN * self.config.temperature_k * self.config.bandwidth_hz

    @property
    def sinr_db(self) -> np.ndarray:
        """Signal of each transmitter over noise and all others [dB], shape [T, C]; -inf where nothing of it arrives."""
        power = self.received_w
        others = np.stack([np.delete(power, row, axis=0).sum(axis=0) for row in range(len(power))])
        return _db(power / (others + self.noise_w))

    @property
    def tx_association(self) -> np.ndarray:
        """Transmitter with the most received power, shape [C], int32; -1 where nothing arrives."""
        power = self.received_w
        return np.where(power.max(axis=0) > 0.0, power.argmax(axis=0), -1).astype(np.int32)

    def metric_db(self, metric: str = "rss", tx: str | None = None) -> np.ndarray:
        """Return a metric of one transmitter, or of the best one in each cell, shape [C], float64.

        Args:
            metric: `path_gain` [dB], `rss` [dBm] or `sinr` [dB].
            tx: Name of the transmitter; None takes the largest value of all.

        Raises:
            InputError: If there is no such metric or transmitter.
        """
        if metric not in METRICS:
            raise InputError(f"radio map: metric = {metric!r}; one of {', '.join(METRICS)} is needed; correct it")
        values = getattr(self, METRICS[metric])
        return values.max(axis=0) if tx is None else values[self.tx_index(tx)]

    def tx_index(self, tx: str) -> int:
        """Return the row of a transmitter.

        Raises:
            InputError: If there is no such transmitter.
        """
        if tx not in self.tx_names:
            raise InputError(f"radio map: no transmitter {tx!r}; it has {', '.join(self.tx_names)}; use one of them")
        return self.tx_names.index(tx)

    def as_grid(self, values: ArrayLike) -> np.ndarray:
        """Return values of cells by row and column, shape [..., C] -> [..., rows, columns].

        Columns run along the plane's x, rows along its y.

        Raises:
            InputError: If the surface is no plane, or the values are not one for each cell.
        """
        array, shape = np.asarray(values), self.surface.grid_shape
        if shape is None:
            raise InputError("radio map: as_grid; only the cells of a plane have rows and columns; use surface='plane'")
        if array.ndim < 1 or array.shape[-1] != len(self.surface):
            raise InputError(
                f"radio map: as_grid of shape {array.shape}; the last axis needs {len(self.surface)} cells; give one "
                "value a cell"
            )
        return array.reshape(*array.shape[:-1], *shape)

    def cdf(self, metric: str = "rss", tx: str | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the empirical distribution of a metric over the area.

        Args:
            metric: `path_gain` [dB], `rss` [dBm] or `sinr` [dB].
            tx: Name of the transmitter; None takes the largest value of all transmitters in each cell.

        Returns:
            The K different finite values, increasing, shape [K]; the share of the area of all cells in which the metric
            is at most that, shape [K]. Cells count by area. Those where nothing arrives are below any value, so that
            the first probability contains their share and the last one is 1.

        Raises:
            InputError: If there is no such metric or transmitter.
        """
        values = self.metric_db(metric, tx)
        found, index = np.unique(values, return_inverse=True)
        probability = np.cumsum(np.bincount(index.ravel(), self.cell_areas)) / self.cell_areas.sum()
        is_finite = np.isfinite(found)
        return found[is_finite], np.minimum(probability[is_finite], 1.0)

    def sample_positions(
        self,
        count: int,
        *,
        metric: str = "rss",
        min_value_db: float | None = None,
        max_value_db: float | None = None,
        min_distance_m: float | None = None,
        max_distance_m: float | None = None,
        tx_association: str | None = None,
        seed: int = 0,
    ) -> np.ndarray:
        """Return random positions, uniform over the area of all cells that fit.

        A cell is judged by the transmitter that serves it, the one of `tx_association`: metric and distance are those
        of that transmitter. A cell where nothing arrives does not fit. Conditions hold for the cell, metric as the mean
        over it and distance from its middle, not for each point in it.

        Args:
            count: Number of positions.
            metric: `path_gain` [dB], `rss` [dBm] or `sinr` [dB].
            min_value_db: Lowest value of the metric; None for no limit.
            max_value_db: Highest value of the metric; None for no limit.
            min_distance_m: Smallest distance from the transmitter [m]; None for no limit.
            max_distance_m: Largest distance from the transmitter [m]; None for no limit.
            tx_association: Name of a transmitter whose cells are wanted; None for those of all.
            seed: Seed; the same one gives the same positions.

        Returns:
            Positions on the measurement surface, world frame [m], shape [count, 3], float64.

        Raises:
            InputError: If there is no such metric or transmitter, a value is no number, or no cell fits.
        """
        if not isinstance(count, int | np.integer) or count < 0:
            raise InputError(f"sample_positions: count = {count!r}; a whole number from 0 on is needed; correct it")
        limits = (
            ("value_db", min_value_db, max_value_db, self._of_server(metric)),
            ("distance_m", min_distance_m, max_distance_m, self._server_distance()),
        )
        server = self.tx_association
        fits = server >= 0 if tx_association is None else server == self.tx_index(tx_association)
        for name, low, high, values in limits:
            for which, limit in (("min", low), ("max", high)):
                if limit is not None and np.isnan(limit):
                    raise InputError(f"sample_positions: {which}_{name} = {limit}; a number is needed; correct it")
            within = values[fits]
            fits &= (values >= (-np.inf if low is None else low)) & (values <= (np.inf if high is None else high))
            if not fits.any():
                have = (
                    f"those left have {within.min():.4g} to {within.max():.4g}" if len(within) else "none has a signal"
                )
                raise InputError(
                    f"sample_positions: no cell fits min_{name} = {low}, max_{name} = {high}; {have}; widen the limits"
                )
        return sample_in_cells(self.surface, fits, int(count), seed)

    def _of_server(self, metric: str) -> np.ndarray:
        """Return a metric of the transmitter that serves each cell, shape [C]."""
        self.metric_db(metric)
        return getattr(self, METRICS[metric])[self.tx_association, np.arange(len(self.surface))]

    def _server_distance(self) -> np.ndarray:
        """Return the distance of each cell's middle from the transmitter that serves it [m], shape [C]."""
        return np.linalg.norm(self.cell_centers - self.transmitters.position[self.tx_association], axis=1)

    def rx_cell_indices(self, positions: ArrayLike, *, max_distance_m: float = 0.5) -> np.ndarray:
        """Return the cell of each position: the nearest one of those it is straight above or below, along their normal.

        Args:
            positions: World frame [m], shape [N, 3] or [3].
            max_distance_m: Positions farther than this from a cell are not in it [m].

        Returns:
            Cell numbers, shape [N] or [], int32; -1 for a position in no cell.

        Raises:
            InputError: If positions have another shape or are not finite.
        """
        places = np.asarray(positions, dtype=np.float64)
        if places.ndim not in (1, 2) or places.shape[-1] != 3 or not np.isfinite(places).all():
            raise InputError(
                f"rx_cell_indices: positions of shape {places.shape}; finite numbers of shape [N, 3] are needed; "
                "correct them"
            )
        if not 0.0 <= max_distance_m < np.inf:
            raise InputError(
                f"rx_cell_indices: max_distance_m = {max_distance_m:g}; it must be 0 m or above; correct it"
            )
        return find_cells(self.surface, places.reshape(-1, 3), max_distance_m).reshape(places.shape[:-1])

    def to_table(self) -> "pa.Table":
        """Return the map as an Arrow table, one row a transmitter and cell; its columns are those of `mmw radiomap`."""
        return radio_map_table(self)

    def plot(self, metric: str = "path_gain", tx: str | None = None, ax: Any = None, *, scene: Any = None) -> Any:
        """Draw the map with matplotlib, seen from above; walls and other upright surfaces in three dimensions.

        Args:
            metric: `path_gain`, `rss`, `sinr`, or `association` for the transmitter that serves each cell.
            tx: Name of the transmitter; None draws the largest value of all.
            ax: Axes to draw into, with `projection="3d"` for upright surfaces; None makes a new figure.
            scene: Scene of the map, whose buildings and vehicles are drawn, too; None for none.

        Returns:
            The matplotlib figure.

        Raises:
            InputError: If there is no such metric or transmitter.
            ImportError: If matplotlib is not installed.
        """
        with needed_by("RadioMap.plot"):
            draw = load_reference("mmw.viz.plots.radio_map_plot:draw_radio_map")
            return draw(self, metric, tx, ax, scene)


def _db(power: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10(power)
