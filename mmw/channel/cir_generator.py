"""Give impulse responses to link simulators, in the form that Sionna PHY's `CIRDataset` reads."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from mmw.channel.scene_paths import Paths
from mmw.core.errors import InputError


class CirGenerator:
    """Yields impulse responses of paths, one sample after the other, all of one shape.

    `sionna.phy.channel.CIRDataset(generator, batch_size, *generator.shape)` reads it; it calls the generator again
    whenever its samples have been used up. Any other consumer of (a, tau) pairs can too.

    Source: protocol of Sionna 2.2, `sionna.phy.channel.CIRDataset`.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> transmitter = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
        >>> receiver = scene.add(mmw.Receiver("ue"))
        >>> solver = mmw.PathSolver(max_depth=1)
        >>> def samples():
        ...     for y in (40.0, 45.0):
        ...         receiver.position = (-2.0, y, 1.5)
        ...         yield solver(scene)
        >>> generator = mmw.channel.CirGenerator(samples, num_paths=10)
        >>> [(a.shape, tau.shape) for a, tau in generator()]
        [((1, 1, 1, 1, 10, 1), (1, 1, 10)), ((1, 1, 1, 1, 10, 1), (1, 1, 10))]
    """

    def __init__(
        self,
        samples: Callable[[], Iterable[Paths]],
        *,
        num_paths: int,
        carrier_hz: float | None = None,
        num_time_steps: int = 1,
        sampling_frequency: float = 1.0,
        normalize_delays: bool = True,
    ):
        """Say where paths come from, and what is made of them.

        Args:
            samples: Function that returns the paths of each sample; it is called anew for every pass.
            num_paths: Paths of each pair in a sample: the strongest ones, or all and padding (a = 0, tau = -1).
            carrier_hz: Carrier [Hz]; None for the only one.
            num_time_steps: Instants of a sample.
            sampling_frequency: Rate of the instants [Hz].
            normalize_delays: Count delays from the first path of each pair, as taps around 0 need it.

        Raises:
            InputError: If there is no path wanted.
        """
        if num_paths < 1:
            raise InputError(f"CirGenerator: num_paths = {num_paths}; at least 1 is needed; correct it")
        self._samples, self._num_paths, self._carrier_hz = samples, num_paths, carrier_hz
        self._options = {
            "num_time_steps": num_time_steps, "sampling_frequency": sampling_frequency,
            "normalize_delays": normalize_delays,
        }  # fmt: skip

    def __call__(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield gains and delays of each sample.

        Yields:
            a: Shape [num_rx, num_rx_ant, num_tx, num_tx_ant, num_paths, num_time_steps], complex64.
            tau: Shape [num_rx, num_tx, num_paths], or with antennas where arrays are not synthetic, float32 [s].

        Raises:
            InputError: If there is no sample, or samples differ in their devices or antennas.
        """
        shape = None
        for paths in self._samples():
            first = paths.sort_by_gain(self._carrier_hz)
            a, tau = first.cir(carrier_hz=self._carrier_hz, num_paths=self._num_paths, **self._options)
            if shape not in (None, a.shape):
                raise InputError(f"CirGenerator: a sample of shape {a.shape} after one of {shape}; they must be equal")
            shape = a.shape
            yield a.astype(np.complex64), tau.astype(np.float32)
        if shape is None:
            raise InputError("CirGenerator: `samples` gave no paths; a dataset needs at least one sample; add one")

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes that `CIRDataset` asks for: num_rx, num_rx_ant, num_tx, num_tx_ant, num_paths, num_time_steps."""
        for a, _ in self():
            return a.shape
        raise AssertionError("an empty generator has raised")
