"""Loss in foliage against Weissberger's formula, and what leaves scatter by."""

from dataclasses import replace

import pytest

from mmw.physics.em.foliage import SCATTERING, foliage_loss_db, with_scattering_foliage
from mmw.physics.materials.material import RadioMaterial
from tests.fixtures.scenes import material


def test_loss_is_weissbergers() -> None:
    assert foliage_loss_db([28e9], [5.0])[0, 0] == pytest.approx(5.8, abs=0.02)
    for ghz in (0.5, 4.9, 28.0, 95.0):
        for length in (0.0, 0.3, 5.0, 13.9):
            assert foliage_loss_db([ghz * 1e9], [length])[0, 0] == pytest.approx(0.45 * ghz**0.284 * length, rel=1e-12)
        for length in (14.0, 60.0, 400.0):
            loss = foliage_loss_db([ghz * 1e9], [length])[0, 0]
            assert loss == pytest.approx(1.33 * ghz**0.284 * length**0.588, rel=1e-12)


def test_both_branches_meet() -> None:
    near, far = foliage_loss_db([28e9], [14.0 - 1e-9, 14.0])[:, 0]
    assert far == pytest.approx(near, rel=0.005)
    assert foliage_loss_db([28e9, 4.9e9], [1.0, 2.0, 3.0]).shape == (3, 2)


def test_only_leaves_without_a_coefficient_get_one() -> None:
    leaves = RadioMaterial("itu", itu="itu_wood", medium="foliage")
    own = replace(leaves, scattering=0.3)
    given = tuple(
        replace(material("wood"), radio=radio) for radio in (leaves, own, RadioMaterial("itu", itu="itu_wood"))
    )
    found = [one.radio.scattering for one in with_scattering_foliage(given)]
    assert found == [SCATTERING, 0.3, 0.0]
