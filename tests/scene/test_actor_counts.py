"""Counts of `frames`: each body once among vehicles, people and drones; agents by their role too."""

import pytest

from mmw.config.agent_keys import AGENT_ROLES
from mmw.scene.actor_counts import BODY_COLUMNS, ROLE_COLUMNS, counted_in
from mmw.usd.actors import FIXED_ROLES, ROLES


@pytest.mark.parametrize(
    ("role", "label", "columns"),
    [
        ("cav", "car", {"cav_count", "vehicle_count"}),
        ("vehicle", "bicycle", {"vehicle_count"}),
        ("vru", "pedestrian", {"vru_count", "pedestrian_count"}),
        ("vru", "bicycle", {"vru_count", "vehicle_count"}),
        ("pedestrian", "pedestrian", {"pedestrian_count"}),
        ("uav", "dynamic", {"uav_count"}),
        ("bs", "static", {"bs_count"}),
        ("rsu", "static", {"rsu_count"}),
    ],
)
def test_columns(role: str, label: str, columns: set[str]) -> None:
    assert set(counted_in(role, label)) == columns


def test_every_body_counts_once() -> None:
    assert set(ROLE_COLUMNS) == set(AGENT_ROLES)
    for role in ROLES:
        assert len(set(counted_in(role, "bicycle")) & set(BODY_COLUMNS)) == (role not in FIXED_ROLES)
