"""Beams from positions: predictors beside plain loops, limits that are known, and the table that the example prints."""

from pathlib import Path

import numpy as np
import pytest

import mmw
from examples.position_beams import main
from mmw.channel import best_beams, ula
from mmw.core.errors import InputError
from mmw.dataset import BeamSearch
from mmw.dataset.beam_samples import BeamSamples, link_samples, with_noise
from mmw.dataset.position_beams import (
    BINS,
    look_up_table,
    most_frequent,
    nearest_neighbors,
    scaled_positions,
    score_positions,
)
from tests.fixtures.deepsense import drive_past, write_scenario
from tests.fixtures.small_dataset import small_dataset

RNG = np.random.default_rng(1)
SCENARIO = "town03_roundabout"


def samples_of(position: np.ndarray, power: np.ndarray) -> BeamSamples:
    return BeamSamples("street", position, power, np.zeros(len(power), dtype=np.int64))


# Predictors


def test_most_frequent_beams_come_first() -> None:
    assert most_frequent(np.array([7, 3, 7, 3, 7, 5])).tolist() == [7, 3, 5]
    assert most_frequent(np.array([4, 4])).tolist() == [4, -1, -1]
    assert most_frequent(np.array([1, 2, 9, 9, 4])).tolist()[0] == 9


def test_neighbors_vote() -> None:
    train, beams, test = RNG.random((40, 2)), RNG.integers(0, 6, 40), RNG.random((15, 2))
    found = nearest_neighbors(train, beams, test, RNG)
    for place, own in zip(test, found, strict=True):
        nearest = sorted(range(40), key=lambda n: np.hypot(*(train[n] - place)))[:5]
        votes = [int(beams[n]) for n in nearest]
        ranked = sorted(set(votes), key=lambda beam: (-votes.count(beam), -beam))[:3]
        assert own[own >= 0].tolist() == ranked


def test_cells_remember() -> None:
    train = np.array([[0.01, 0.01], [0.02, 0.03], [0.03, 0.01], [1.0, 1.0]])
    beams, test = np.array([5, 5, 6, 9]), np.array([[0.0, 0.0], [0.99, 0.99], [0.5, 0.5]])
    found = look_up_table(train, beams, test, np.random.default_rng(0))
    assert found[0].tolist() == [5, 6, -1] and found[1].tolist() == [9, -1, -1]
    assert 0 <= found[2, 0] <= 9 and found[2, 1:].tolist() == [-1, -1]  # an empty cell: a guess
    assert BINS == 25


# Scores


def test_a_street_without_errors_is_known_and_chance_is_not() -> None:
    """Beams are 0.4 m wide and positions 15 mm apart: all but those at borders are right; shuffled ones by chance."""
    position, power = drive_past(2000)
    exact = score_positions(samples_of(position, power))
    assert exact.top[0] > 90.0 and exact.top[2] > 99.0 and exact.samples == 2000
    assert exact.top[0] < exact.top[1] <= exact.top[2] and max(exact.spread) < 2.0
    shuffled = score_positions(samples_of(position, RNG.permutation(power)))
    counts = np.bincount(power.argmax(axis=1)) / 2000.0
    chance = 100.0 * np.square(counts).sum()  # of a guess as frequent as each beam is
    assert shuffled.top[0] == pytest.approx(chance, abs=100.0 * 4.0 * np.sqrt(chance / 100.0 / 2000.0))


def test_errors_of_positions_cost_accuracy() -> None:
    """A meter is 4 degrees at 15 m, three beams."""
    position, power = drive_past(2000)
    noisy = position + 9e-6 * RNG.normal(size=position.shape)
    good, bad = (score_positions(samples_of(place, power)).top for place in (position, noisy))
    assert bad[0] < 0.5 * good[0] and bad[2] < good[2]


def test_the_same_samples_score_the_same() -> None:
    samples = samples_of(*drive_past(200))
    assert score_positions(samples, runs=2) == score_positions(samples, runs=2)
    assert score_positions(samples, look_up_table, runs=2) != score_positions(samples, runs=2)


def test_positions_are_scaled_to_one() -> None:
    place = scaled_positions(samples_of(*drive_past(100)))
    np.testing.assert_array_equal([place.min(axis=0), place.max(axis=0)], [[0.0, 0.0], [1.0, 1.0]])
    position, power = drive_past(100)
    position[:, 0] = 33.0
    with pytest.raises(InputError, match="do not differ in both axes"):
        score_positions(samples_of(position, power))
    with pytest.raises(InputError, match="4 samples, 5 runs"):
        score_positions(samples_of(*drive_past(4)))


# Samples


def test_samples_of_links_have_the_beams_of_a_search() -> None:
    search = BeamSearch(ula(16), ula(1), tx_beams=64, rx_beams=1, subcarriers=64)
    samples = link_samples(small_dataset(), scenario=SCENARIO, carrier_hz=28e9)
    data = mmw.open(small_dataset())
    fixes = data.pandas("gnss", scenario=SCENARIO, weather="sunny")
    beams = mmw.connect(small_dataset(), search=search).sql(
        f"SELECT agent, frame, tx_beam, gain FROM beams WHERE scenario = '{SCENARIO}' AND weather = 'sunny' "
        "AND peer = 'rsu_1' AND carrier_hz = 28e9 AND tx_beam >= 0"
    ).df()  # fmt: skip
    beams = beams.merge(fixes, on=["agent", "frame"]).sort_values(["agent", "frame"], ignore_index=True)
    assert len(samples) == len(beams) > 0
    np.testing.assert_array_equal(samples.beams, beams["tx_beam"])
    np.testing.assert_allclose(samples.power.max(axis=1), beams["gain"], rtol=1e-9)
    np.testing.assert_array_equal(samples.position_deg, beams[["latitude_deg", "longitude_deg"]])
    assert best_beams(samples.power[:, None]).tx_beam.tolist() == samples.beams.tolist()
    one = link_samples(small_dataset(), scenario=SCENARIO, carrier_hz=28e9, agents=[str(beams["agent"][0])])
    assert len(np.unique(samples.sequence)) == beams["agent"].nunique() and set(one.sequence) == {0}


def test_noise_is_that_of_a_receiver() -> None:
    """Mean |sqrt(P) + n|^2 = P + N, deviation sqrt(2 P N + N^2); of links by the seed."""
    power = np.full((20_000, 2), [4.0, 0.0])
    found = with_noise(power, 6.0, np.random.default_rng(0))
    noise = 4.0 * 10.0**-0.6
    np.testing.assert_allclose(found.mean(axis=0), power[0] + noise, atol=5.0 * 3.0 / np.sqrt(20_000))
    np.testing.assert_allclose(found.std(axis=0), np.sqrt(2.0 * power[0] * noise + noise**2), rtol=0.05)
    clean, noisy, again = (
        link_samples(small_dataset(), scenario=SCENARIO, carrier_hz=28e9, snr_db=snr_db, seed=3).power
        for snr_db in (None, 20.0, 20.0)
    )
    assert (noisy == again).all() and (noisy != clean).all() and np.abs(noisy - clean).max() < clean.max()


def test_links_that_are_not_there_are_named() -> None:
    with pytest.raises(InputError, match="no link from rsu_1 has a path and a position"):
        link_samples(small_dataset(), scenario=SCENARIO, carrier_hz=28e9, agents=["cav_77"])
    with pytest.raises(InputError, match="no link from nobody"):
        link_samples(small_dataset(), scenario=SCENARIO, carrier_hz=28e9, peer="nobody")


def test_samples_fit_together() -> None:
    position, power = drive_past(10)
    with pytest.raises(InputError, match="one row a sample"):
        BeamSamples("s", position[:9], power, np.zeros(10, dtype=np.int64))
    power[4] = np.nan
    with pytest.raises(InputError, match="sample 4 has no power"):
        samples_of(position, power)


# Example


def test_the_table_has_measured_own_and_published_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_scenario(tmp_path, *drive_past(60), number=5)
    main(["--deepsense", str(folder)])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[-1] == "published" and len(lines) == 1 + 9
    measured = lines[1].split()
    assert measured[:2] == ["scenario5", "60"] and measured[-3:] == ["41.2", "64.0", "77.9"] and len(measured) == 11
    main([str(small_dataset()), "--carrier", "28e9"])
    assert capsys.readouterr().out.splitlines()[1].split()[:2] == [SCENARIO, "6"]
    with pytest.raises(InputError, match="name one by --carrier"):
        main([str(small_dataset())])
