"""Codebooks and best beams against loops written out, and against the direction of a lone path."""

import numpy as np
import pytest

from mmw.channel import PlanarArray, apply_arrays, beam_gains, best_beams, dft_codebook, normalized_gain, ula, upa
from mmw.channel.codebook import dft_ula
from tests.fixtures.path_tables import CARRIER, sight


def random_channel(*shape: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def test_linear_codebook_is_the_papers() -> None:
    book = dft_ula(16, 64)
    assert book.shape == (16, 64)
    for q in (0, 1, 17, 63):
        for n in range(16):
            assert book[n, q] == pytest.approx(np.exp(2j * np.pi * n * q / 64) / 4, abs=1e-14)
    np.testing.assert_allclose(np.linalg.norm(book, axis=0), 1.0)
    np.testing.assert_allclose(book @ book.conj().T, 64 / 16 * np.eye(16), atol=1e-13)
    square = dft_ula(8, 8)
    np.testing.assert_allclose(square.conj().T @ square, np.eye(8), atol=1e-14)
    for array in (ula(16), PlanarArray(num_rows=16)):
        np.testing.assert_array_equal(dft_codebook(array, 64), book)


def test_planar_codebook_has_the_order_of_the_elements() -> None:
    array = upa(3, 4)
    book = dft_codebook(array, (5, 6))
    position = array.element_positions(CARRIER)
    y, z = (np.round((position[:, k] - position[0, k]) / np.ptp(position[:, k]) * n) for k, n in ((1, 3), (2, 2)))
    for q_h in range(6):
        for q_v in range(5):
            expected = np.exp(2j * np.pi * (y * q_h / 6 - z * q_v / 5)) / np.sqrt(12)
            np.testing.assert_allclose(book[:, q_h * 5 + q_v], expected, atol=1e-14)
    dual = dft_codebook(upa(3, 4, polarization="VH"), (5, 6))
    assert dual.shape == (24, 60)
    np.testing.assert_array_equal(dual[:12, :30], book)
    np.testing.assert_array_equal(dual[12:, 30:], book)
    assert not dual[:12, 30:].any() and not dual[12:, :30].any()
    with pytest.raises(ValueError, match=r"beams = 64 for 3 x 4 elements; give \(down the columns"):
        dft_codebook(array)
    with pytest.raises(ValueError, match="0 elements"):
        dft_ula(0)


@pytest.mark.parametrize("subcarriers", [0, 5])
def test_search_against_loops(subcarriers: int) -> None:
    h = random_channel(7, 4, 8, *([subcarriers] if subcarriers else []))
    h[3] = 0.0
    f, w = dft_ula(8, 16), dft_ula(4, 12)
    gains = beam_gains(h, f, w)
    best = best_beams(gains)
    mean = h.mean(axis=3) if subcarriers else h
    chosen = np.random.default_rng(2).integers(0, 16, 7)
    ratio = normalized_gain(gains, chosen)
    for link in range(7):
        largest, pair = 0.0, (-1, -1)
        for p in range(12):
            for q in range(16):
                gain = abs(np.vdot(w[:, p], mean[link] @ f[:, q])) ** 2
                assert gains[link, p, q] == pytest.approx(gain, abs=1e-12)
                if gain > largest * (1 + 1e-12):
                    largest, pair = gain, (p, q)
        assert (best.rx_beam[link], best.tx_beam[link]) == pair
        assert best.gain[link] == pytest.approx(largest)
        if link == 3:
            assert np.isnan(ratio[link]) and pair == (-1, -1) and best.gain[link] == 0.0
        else:
            got = abs(np.vdot(w[:, pair[0]], mean[link] @ f[:, chosen[link]])) ** 2
            assert ratio[link] == pytest.approx(got / largest)


def test_ties_go_to_the_lowest_index() -> None:
    """A single active antenna hears all beams equally well but for rounding; a swap of links changes no beam."""
    h = np.zeros((3, 4, 8), dtype=complex)
    h[0, 2, 5] = 0.3 - 0.1j
    h[1, 1] = np.exp(0.5j * np.arange(8))
    h[2, :, 3] = dft_ula(4, 12)[:, 7]
    gains = beam_gains(h, dft_ula(8, 64), dft_ula(4, 12))
    best = best_beams(gains)
    assert (best.rx_beam[0], best.tx_beam[0]) == (0, 0)
    assert best.rx_beam[1] == 0 and best.tx_beam[1] == np.argmax(gains[1, 0])
    assert (best.rx_beam[2], best.tx_beam[2]) == (7, 0)
    back = best_beams(gains[::-1])
    np.testing.assert_array_equal(back.tx_beam[::-1], best.tx_beam)
    np.testing.assert_array_equal(back.rx_beam[::-1], best.rx_beam)


def test_a_lone_path_picks_the_beams_of_its_directions() -> None:
    """Beams at -2q/Q (precoder) and +2p/Q (combiner) in sin(azimuth), to half a beam."""
    angle = np.radians(np.linspace(-60, 60, 25))
    gap = 80.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    paths = sight(np.zeros_like(gap), gap)
    facing = np.diag([-1.0, -1.0, 1.0])  # the receiver looks back at the transmitter
    a = apply_arrays(paths, ula(64), ula(16), CARRIER, rx_rotation=facing)
    best = best_beams(beam_gains(a, dft_ula(64), dft_ula(16)))

    def wrapped(value: np.ndarray) -> np.ndarray:
        return (value + 1) % 2 - 1

    np.testing.assert_array_less(np.abs(wrapped(np.sin(angle) + 2 * best.tx_beam / 64)), 1 / 64 + 1e-9)
    np.testing.assert_array_less(np.abs(wrapped(np.sin(angle) - 2 * best.rx_beam / 64)), 1 / 64 + 1e-9)
    share = best.gain / (np.abs(a[:, 0, 0]) ** 2 * 64 * 16)
    assert (share <= 1 + 1e-12).all() and share.min() > 0.4  # half a beam off at the worst: (2 / pi)^2


def test_normalized_gain_of_several_beams() -> None:
    gains = beam_gains(random_channel(6, 4, 8), dft_ula(8, 16), dft_ula(4, 12))
    best = best_beams(gains)
    every = normalized_gain(gains, np.tile(np.arange(16), (6, 1)), best)
    assert every.shape == (6, 16)
    np.testing.assert_array_equal(every.argmax(axis=1), best.tx_beam)
    np.testing.assert_allclose(every.max(axis=1), 1.0)
    np.testing.assert_array_equal(normalized_gain(gains, best.tx_beam), every.max(axis=1))
    with pytest.raises(ValueError, match="outside 0 to 15"):
        normalized_gain(gains, np.full(6, 16))
    with pytest.raises(ValueError, match=r"tx_beam has shape \(5,\)"):
        normalized_gain(gains, np.zeros(5, dtype=int))
    with pytest.raises(ValueError, match=r"h has shape \(6, 8, 4\), codebooks are for 4 receive and 8 transmit"):
        beam_gains(random_channel(6, 8, 4), dft_ula(8, 16), dft_ula(4, 12))
