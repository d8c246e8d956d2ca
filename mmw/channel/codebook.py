"""Make DFT codebooks and find the best pair of beams by exhaustive search.

Source: the Multimodal-Wireless paper, section on beam prediction: codebook, search and normalized gain.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.antennas.arrays import PlanarArray
from mmw.core.errors import InputError

TIE = 1e-12
"""Gains closer than this share of the largest one are equal; rounding would otherwise pick between equal beams."""


@dataclass(frozen=True, eq=False)
class BeamPairs:
    """The best beams of L links. A link without path has -1, -1 and gain 0."""

    rx_beam: np.ndarray
    """Index p* of the combiner, shape [L], int64."""
    tx_beam: np.ndarray
    """Index q* of the precoder, shape [L], int64."""
    gain: np.ndarray
    """|w(p*)^H H f(q*)|^2, shape [L]."""


def dft_ula(count: int, beams: int = 64) -> np.ndarray:
    """Return the DFT codebook of a linear array; column q is f(q) = [1, e^{j2 pi q/Q}, ...]^T / sqrt(N).

    Args:
        count: Elements N.
        beams: Beams Q. Q = N is an orthonormal basis, more beams lie closer.

    Returns:
        Unit columns, shape [N, Q], complex128. With half a wavelength between elements, precoder q sends most to the
        directions with sin(theta) sin(phi) = -2 q / Q, and combiner q hears most from those with +2 q / Q, both taken
        modulo 2 into -1 ... 1, in the array's frame. The signs differ because w is conjugated and f is not.

    Raises:
        InputError: If a count is below 1.
    """
    if count < 1 or beams < 1:
        raise InputError(f"dft_ula: {count} elements, {beams} beams; both are at least 1")
    # The product is reduced by whole turns first, so that equal phases are equal numbers.
    turns = np.mod(np.outer(np.arange(count), np.arange(beams)), beams) / beams
    return np.exp(2j * np.pi * turns) / np.sqrt(count)


def dft_codebook(array: PlanarArray, beams: int | tuple[int, int] = 64) -> np.ndarray:
    """Return the DFT codebook of an array, in the order of its antennas.

    That of a planar array is the Kronecker product of the horizontal and the vertical one: beam q_h Q_v + q_v is beam
    q_h of `dft_ula(N, Q_h)` along the rows and q_v of `dft_ula(M, Q_v)` down the columns.

    Args:
        array: Linear or planar array.
        beams: Beams Q of a linear array; beams (down the columns, along the rows) of a planar one.

    Returns:
        Unit columns, shape [antennas, beams]. An array of several polarizations has all beams for the first, then all
        for the second: a beam feeds one polarization.

    Raises:
        InputError: If a planar array gets one number, or an array has no rows and columns.

    Examples:
        >>> from mmw.channel import ula, upa
        >>> dft_codebook(ula(16), 32).shape, dft_codebook(upa(4, 8), (8, 16)).shape
        ((16, 32), (32, 128))
    """
    if not isinstance(array, PlanarArray):
        raise InputError(
            f"dft_codebook: an {type(array).__name__} has no rows and columns; a PlanarArray is needed, or a codebook "
            "of your own, shape [antennas, beams]"
        )
    if isinstance(beams, tuple):
        row_beams, column_beams = beams
    elif array.num_rows == 1:
        row_beams, column_beams = 1, beams
    elif array.num_cols == 1:
        row_beams, column_beams = beams, 1
    else:
        raise InputError(
            f"dft_codebook: beams = {beams} for {array.num_rows} x {array.num_cols} elements; give (down the columns, "
            "along the rows)"
        )
    book = np.kron(dft_ula(array.num_cols, column_beams), dft_ula(array.num_rows, row_beams))
    return np.kron(np.eye(array.polarization_count), book)


def beam_gains(h: np.ndarray, tx_codebook: np.ndarray, rx_codebook: np.ndarray) -> np.ndarray:
    """Return |w(p)^H H f(q)|^2 of every pair of beams.

    Args:
        h: Channels, shape [L, N_r, N_t], or [L, N_r, N_t, K], which is averaged over the K subcarriers first.
        tx_codebook: Precoders f(q) as columns, shape [N_t, Q_t].
        rx_codebook: Combiners w(p) as columns, shape [N_r, Q_r].

    Returns:
        Shape [L, Q_r, Q_t]; 0 for a link without path.

    Raises:
        InputError: If shapes do not fit.

    Examples:
        >>> import mmw
        >>> from mmw.channel import apply_arrays, dft_codebook, frequency_response, ula
        >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 1))
        >>> a = apply_arrays(paths, ula(8), ula(4), 28e9)
        >>> h = frequency_response(a, paths, [0.0], 28e9)
        >>> beam_gains(h, dft_codebook(ula(8), 8), dft_codebook(ula(4), 4)).shape  # links, combiners, precoders
        (3, 4, 8)
    """
    h = h.mean(axis=-1) if h.ndim == 4 else h
    if h.ndim != 3 or h.shape[1:] != (len(rx_codebook), len(tx_codebook)):
        raise InputError(
            f"beam_gains: h has shape {h.shape}, codebooks are for {len(rx_codebook)} receive and {len(tx_codebook)} "
            "transmit antennas; h is [L, N_r, N_t] or [L, N_r, N_t, K]"
        )
    return np.abs(rx_codebook.conj().T @ h @ tx_codebook) ** 2


def best_beams(gains: np.ndarray) -> BeamPairs:
    """Return the pair of beams with the largest gain of every link.

    Among equal gains (within `TIE` of the largest) the lowest receive beam wins, then the lowest transmit beam.

    Args:
        gains: Gains of all pairs from `beam_gains`, shape [L, Q_r, Q_t].

    Examples:
        >>> import numpy as np
        >>> gains = np.array([[[0.1, 0.4], [0.9, 0.2]]])  # one link, two combiners, two precoders
        >>> best = best_beams(gains)
        >>> best.rx_beam.tolist(), best.tx_beam.tolist(), best.gain.tolist()
        ([1], [0], [0.9])
    """
    links, _, tx_beams = gains.shape
    flat = gains.reshape(links, -1)
    best = flat.max(axis=1)
    pair = np.argmax(flat >= best[:, None] * (1 - TIE), axis=1)
    is_there = best > 0
    rx_beam, tx_beam = np.divmod(pair, tx_beams)
    gain = flat[np.arange(links), pair]
    return BeamPairs(np.where(is_there, rx_beam, -1), np.where(is_there, tx_beam, -1), gain)


def normalized_gain(gains: np.ndarray, tx_beam: ArrayLike, best: BeamPairs | None = None) -> np.ndarray:
    """Return G(q) = |w(p*)^H H f(q)|^2 / |w(p*)^H H f(q*)|^2 of chosen transmit beams, with the best receive beam.

    Args:
        gains: Gains of all pairs from `beam_gains`, shape [L, Q_r, Q_t].
        tx_beam: Chosen transmit beam q of each link, shape [L], or several a link, shape [L, n].
        best: Best pairs from `best_beams`; found here when not given.

    Returns:
        0 to 1 (to within `TIE`), shape of `tx_beam`; NaN for a link without path, whatever was chosen there.

    Raises:
        InputError: If a beam of a link with paths is not in the codebook, or there are not L rows.

    Examples:
        >>> import numpy as np
        >>> gains = np.array([[[0.1, 0.4], [0.9, 0.45]]])
        >>> normalized_gain(gains, [1]).tolist()  # the second precoder instead of the first
        [0.5]
    """
    best = best_beams(gains) if best is None else best
    chosen = np.asarray(tx_beam)
    if chosen.ndim not in (1, 2) or len(chosen) != len(gains):
        raise InputError(f"normalized_gain: tx_beam has shape {chosen.shape}; it is [L] or [L, n], L = {len(gains)}")
    is_there = best.gain > 0
    rows = chosen.reshape(len(gains), -1)
    if ((rows < 0) | (rows >= gains.shape[2]))[is_there].any():
        raise InputError(f"normalized_gain: tx_beam holds beams outside 0 to {gains.shape[2] - 1}; name beams inside")
    link = np.arange(len(gains))[:, None]
    picked = gains[link, best.rx_beam[:, None], np.where(is_there[:, None], rows, 0)]
    ratio = picked / np.where(is_there, best.gain, np.nan)[:, None]
    return ratio.reshape(chosen.shape)
