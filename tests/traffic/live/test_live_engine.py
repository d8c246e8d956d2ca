"""The engine of live traffic: without controls it is the recorded one bit by bit, and what is absent is not seen."""

import numpy as np
import pytest

from mmw.traffic.idm.simulation import start_fleet
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_engine import LiveEngine
from tests.fixtures.traffic_towns import crossroad, demand, oval, with_lights


@pytest.mark.parametrize("town", ["lights", "lanes"])
def test_without_controls_every_step_is_that_of_the_recorded_engine(town: str) -> None:
    """Stations, speeds, lights, who waits for them and for whom, and changes of lanes of 40 s."""
    lit = town == "lights"
    graph = with_lights(crossroad(), "X", {"r0": "a", "r2": "a", "r1": "b", "r3": "b"}) if lit else oval()
    asked = demand(graph, vehicle_count=20, cav_ranks=(0, 3), frame_count=4000, signals=lit)
    recorded, (live, _) = start_fleet(asked)[0], start_fleet(asked, LiveEngine, may_leave=False)
    for slow in (recorded.cars[0], live.cars[0]):  # others overtake it
        slow.plan.limit = [min(speed, 6.0) for speed in slow.plan.limit]
    reds, states = 0, set()
    for _ in range(800):
        recorded.step()
        live.step()
        assert [(car.station, car.speed, car.acceleration) for car in live.cars] == [
            (car.station, car.speed, car.acceleration) for car in recorded.cars
        ]
        assert live.states == recorded.states and live.at_red == recorded.at_red
        assert live.blockers == recorded.blockers
        reds += len(live.at_red)
        states |= {str(state) for state in live.states.values()}
    changes = [[] if engine.changes is None else engine.changes.done for engine in (live, recorded)]
    assert changes[0] == changes[1]
    assert (reds > 100 and len(states) > 3) if lit else changes[0]


def test_vehicle_off_the_lanes_is_in_nobodys_way() -> None:
    asked = demand(oval(), vehicle_count=6, cav_ranks=(0,), frame_count=4000, lane_changes=False)
    engine, _ = start_fleet(asked, LiveEngine, may_leave=False)
    engine.command(0, Control(acceleration_m_s2=-6.0))
    for _ in range(400):
        engine.step()
    behind = np.array([car.speed for car in engine.cars])
    assert (behind < 0.1).sum() >= 2, "a queue"
    engine.remove(0)
    for _ in range(200):
        engine.step()
    assert all(car.speed > 2.0 for index, car in enumerate(engine.cars) if index != 0)
    assert engine.cars[0].speed == 0.0


def test_fleet_that_starts_anew_beside_the_first_has_its_stances() -> None:
    """Paths on the ground are computed once as long as a vehicle has them; the motion is that of the first."""
    asked = demand(crossroad(), vehicle_count=8, cav_ranks=(0,), frame_count=600)
    first, again = (start_fleet(asked, LiveEngine, may_leave=False)[0] for _ in range(2))
    assert all(one.plan.stance is other.plan.stance for one, other in zip(first.cars, again.cars, strict=True))
    assert first.table is again.table and first.samples is again.samples
    for _ in range(100):
        first.step()
    other = start_fleet(asked.with_seed(asked.seed + 1), LiveEngine, may_leave=False)[0]
    for _ in range(100):
        again.step()
    assert [car.station for car in again.cars] == [car.station for car in first.cars]
    assert [car.paint for car in other.cars] != [car.paint for car in first.cars]
