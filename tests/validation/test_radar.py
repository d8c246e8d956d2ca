"""The published pattern of vehicles, and figures of the radar's rows."""

import numpy as np
import pytest

from mmw.validation.checks.radar import CHECKS, vehicle_pattern


def test_the_pattern_of_vehicles_has_its_peaks_and_floors() -> None:
    """TR 38.901, table 7.9.2.1-4, seen level: peaks less the zenith term; 45 degrees off, G_max - sigma_max."""
    left = 20.75 - 12.0 * (10.3 / 44.42) ** 2
    front = 15.52 - 12.0 * (18.25 / 29.13) ** 2
    back = 14.56 - 12.0 * (10.35 / 36.73) ** 2
    found = vehicle_pattern(np.array([0.0, 90.0, 180.0, 270.0, 360.0, -90.0]))
    np.testing.assert_allclose(found, [front, left, back, left, front, left], atol=1e-9)
    np.testing.assert_allclose(vehicle_pattern(np.array([46.0, 136.0, 316.0])), [7.07, 7.06, 7.07], atol=1e-9)


def test_rows_that_need_no_scene_of_a_town_run_in_seconds() -> None:
    """Reflectors: the cheapest rows run here, the others in CI by `mmw validate`."""
    rows = {check.name: check for check in CHECKS}
    for name in ("radar.plate", "radar.dihedral", "radar.trihedral"):
        value = rows[name].measure("cpu").value
        assert rows[name].reference.contains(value)


def test_figures_have_computed_and_published_values() -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    (row,) = (check for check in CHECKS if check.name == "radar.vehicle_mean")
    measurement = row.measure("cpu")
    assert measurement.draw is not None and row.reference.contains(measurement.value)
    measurement.draw(axes)
    assert [line.get_label() for line in axes.get_lines()] == ["sedan", "hatchback", "suv", "TR 38.901"]
