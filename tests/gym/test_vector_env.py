"""Vector environments: the rewards and observations of single environments, new episodes, refused calls."""

from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'multimodal-wireless[gym]'")
pytest.importorskip("pettingzoo", reason="PettingZoo is not installed: pip install 'multimodal-wireless[gym]'")

import gymnasium
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode

from mmw.core.errors import InputError
from mmw.gym import BeamTracking, BeamTrackingVector, Handover, HandoverVector
from mmw.gym.handover import TWO_STATIONS

CAMERA = "sensors=[{type: rgb, name: front, width_px: 32, height_px: 24, on: [cav_1]}]"
TRAFFIC = "scenarios.town03_roundabout.traffic.vehicle_count=9"
SHORT = ("frames.count=60", CAMERA, TRAFFIC, "vary.spawn.radius_m=80")
IMAGE = (Box(0, 255, (24, 32, 3), np.uint8), lambda agent: agent.sensor("front").rgb)


@pytest.fixture(scope="module")
def envs() -> Iterator[BeamTrackingVector]:
    """Return two worlds with a camera, whose episodes begin in one of three frames."""
    made = gymnasium.make_vec(
        "mmw/BeamTracking-v0",
        num_envs=2,
        vectorization_mode="vector_entry_point",
        overrides=SHORT,
        max_start=2,
        device="cpu",
        extra={"image": IMAGE},
    )
    assert isinstance(made.unwrapped, BeamTrackingVector)
    yield made.unwrapped
    made.close()


def of_one(seed: int) -> tuple[str, ...]:
    """Return the overrides of the single environment of a world."""
    return f"seed={seed}", "scene_seed=42"


@pytest.mark.slow
def test_worlds_are_single_environments_up_to_the_episode_after_the_first(envs: BeamTrackingVector) -> None:
    """SNRs of several links are summed in another order by BLAS, hence the tolerance of 1e-6."""
    singles = [
        BeamTracking(overrides=(*SHORT, *of_one(42 + k)), max_start=2, device="cpu", extra={"image": IMAGE})
        for k in range(2)
    ]
    observed, infos = envs.reset(seed=5)
    starts = [env.reset(seed=5 + k) for k, env in enumerate(singles)]
    is_over, count = [False, False], 0
    while count < 8:
        for k, (own, info) in enumerate(starts):
            assert envs.observation_space.contains(observed)
            assert {name: value[k].shape for name, value in observed.items()} == {
                n: np.shape(v) for n, v in own.items()
            }
            for name, value in own.items():
                assert observed[name][k] == pytest.approx(value, rel=1e-6, abs=1e-6), name
            assert infos["best_beam"][k] == info["best_beam"] and infos["_best_beam"][k]
            assert infos["best_reward"][k] == pytest.approx(info["best_reward"], rel=1e-6)
        actions = np.array([count, infos["best_beam"][1]])
        observed, rewards, terminated, truncated, infos = envs.step(actions)
        assert not terminated.any() and rewards.dtype == np.float64
        for k, env in enumerate(singles):
            if is_over[k]:  # the next step begins an episode
                starts[k] = env.reset()
                assert rewards[k] == 0.0 and not truncated[k]
                is_over[k] = False
            else:
                own, reward, _, is_over[k], info = env.step(actions[k])
                starts[k] = own, info
                assert rewards[k] == pytest.approx(reward, rel=1e-6) and truncated[k] == is_over[k]
        count += 1
    for env in singles:
        env.close()


@pytest.mark.slow
def test_worlds_start_anew_by_mask_and_with_other_traffic(envs: BeamTrackingVector) -> None:
    first, _ = envs.reset(seed=5)
    other, infos = envs.reset(seed=5, options={"reset_mask": np.array([False, True]), "traffic_seed": 100})
    assert envs.simulation.seeds == (42, 101)
    assert np.array_equal(other["position"][0], first["position"][0])
    assert not np.allclose(other["position"][1], first["position"][1])
    assert infos["_best_beam"].tolist() == [False, True]
    again, _ = envs.reset(seed=[5, 6], options={"traffic_seed": 42})
    assert all(np.array_equal(again[name], first[name]) for name in first)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


@pytest.mark.slow
def test_bad_calls_move_no_world(envs: BeamTrackingVector) -> None:
    envs.reset(seed=1)
    before = envs.simulation.present
    for actions, text in (
        (np.array([0, 64]), "world 1: action = 64; 0 to 63"),
        (np.array([0]), "for each of 2 worlds"),
        (np.array([0.0, 1.0]), "a whole number for each"),
    ):
        with pytest.raises(InputError, match=text):
            envs.step(actions)
    with pytest.raises(InputError, match="speed is not known"):
        envs.reset(options={"speed": 1})
    with pytest.raises(InputError, match="seed has 3 entries"):
        envs.reset(seed=[1, 2, 3])
    with pytest.raises(InputError, match="one true, is needed"):
        envs.reset(options={"reset_mask": np.zeros(2, dtype=bool)})
    assert all(one is other for one, other in zip(before, envs.simulation.present, strict=True))
    with pytest.raises(InputError, match=r"beam.*has an observation of this name"):
        BeamTrackingVector(1, overrides=SHORT, max_start=0, device="cpu", extra={"beam": IMAGE})
    with pytest.raises(InputError, match="two or more different"):
        HandoverVector(2, peers=("rsu_1",))
    with pytest.raises(InputError, match="interruption_s = 1"):
        HandoverVector(2, interruption_s=1.0)


@pytest.mark.slow
def test_change_of_station_costs_its_interruption_as_in_one_world() -> None:
    given = (*TWO_STATIONS, "frames.count=40", TRAFFIC)
    envs = HandoverVector(2, overrides=given, max_start=0, device="cpu", draw_traffic=True)
    envs.reset(seed=1)
    seeds, before = envs.simulation.seeds, envs._serving.copy()
    _, rewards, _, _, infos = envs.step(np.array([before[0], 1 - before[1]]))
    assert seeds[0] != seeds[1] and 42 not in seeds  # drawn
    for k, choice in enumerate((before[0], 1 - before[1])):
        env = Handover(overrides=(*given, f"seed={seeds[k]}", "scene_seed=42"), max_start=0, device="cpu")
        env.reset(seed=1)
        env._serving = int(before[k])
        _, reward, *_, info = env.step(np.int64(choice))
        assert rewards[k] == pytest.approx(reward, rel=1e-6)
        assert infos["best_reward"][k] == pytest.approx(info["best_reward"], rel=1e-6)
        env.close()
    envs.close()
    envs.close()
