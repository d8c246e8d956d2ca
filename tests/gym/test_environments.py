"""Environments of Gymnasium: its own checker, rewards against the definition, refused arguments."""

from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'multimodal-wireless[gym]'")
pytest.importorskip("pettingzoo", reason="PettingZoo is not installed: pip install 'multimodal-wireless[gym]'")

import gymnasium
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test

import mmw
from mmw.core.errors import InputError
from mmw.gym import BeamTracking, Fleet, Handover, RadioLink

SHORT = ("frames.count=90", "sensors=[{type: rgb, name: front, width_px: 32, height_px: 24, on: [cav_1]}]")
IMAGE = (Box(0, 255, (24, 32, 3), np.uint8), lambda agent: agent.sensor("front").rgb)


@pytest.fixture(scope="module")
def tracking() -> Iterator[BeamTracking]:
    """Return the environment with a camera, whose episodes begin in one of three frames."""
    env = BeamTracking(overrides=SHORT, max_start=2, device="cpu", extra={"image": IMAGE})
    yield env
    env.close()


@pytest.fixture(scope="module")
def handover() -> Iterator[Handover]:
    """Return the environment with two stations."""
    defaults = Handover.__init__.__kwdefaults__["overrides"]
    env = Handover(overrides=(*defaults, "frames.count=90"), max_start=0, device="cpu")
    yield env
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tracking", "handover"])
def test_gymnasium_finds_no_fault(name: str, request: pytest.FixtureRequest) -> None:
    check_env(request.getfixturevalue(name), skip_render_check=True)


@pytest.mark.slow
def test_reward_of_a_beam_is_its_capacity_on_the_paths_of_the_frame(tracking: BeamTracking) -> None:
    """An oracle sums the paths of the link in float64, element by element: isotropic, narrow, plane waves."""
    tracking.reset(seed=1)
    link = tracking.link
    observation, reward, terminated, _, info = tracking.step(np.int64(5))
    frame = tracking.frame
    paths = next(one for one in frame.links if one.agent == "cav_1" and one.carrier_hz == 28e9).paths
    whole = frame.paths(28e9)
    own = whole.take([[str(key["agent"]) for key in whole.keys].index("cav_1")])
    assert len(own) == len(paths["tau_s"]) > 0
    snr = link.snr(frame, "cav_1", ("rsu_1",))[0]
    assert snr.shape == (64, 16)
    total = snr.sum(axis=0) * link.noise_w / (10 ** (0.1 * link.power_dbm - 3.0))  # Parseval: all beams of a DFT book
    h = mmw.channel.frequency_response(
        mmw.channel.apply_arrays(
            own, link.tx_array, mmw.channel.ula(1), 28e9, *(rotation(frame, name) for name in ("rsu_1", "cav_1"))
        ),
        own,
        mmw.channel.subcarrier_frequencies(16, 100e6 / 16),
        28e9,
    )
    assert total == pytest.approx((np.abs(h[0, 0]) ** 2).sum(axis=0), rel=1e-9)
    assert link.noise_w == pytest.approx(4.0039e-21 * 1e8 * 5.0119, rel=1e-4)  # -174 dBm/Hz, 80 dB, 7 dB
    rates = [np.mean([np.log2(1 + value) for value in beam]) for beam in snr]
    assert reward == pytest.approx(rates[5]) and info["best_reward"] == pytest.approx(max(rates))
    assert info["best_beam"] == int(np.argmax(rates)) and not terminated
    assert observation["beam"] == 5 and observation["image"].shape == (24, 32, 3)
    assert observation["snr_db"][0] == pytest.approx(max(10 * np.log10(snr[5].mean()), -60.0), rel=1e-5)
    pose = frame.agents["rsu_1"].pose
    away = np.linalg.norm(frame.agents["cav_1"].pose[:3] - pose[:3])
    assert np.linalg.norm(observation["position"]) == pytest.approx(away, rel=1e-6)


def rotation(frame: mmw.Frame, name: str) -> np.ndarray:
    """Return the rotation of an agent as a batch of one."""
    from mmw.core.transforms import quaternion_to_matrix

    return quaternion_to_matrix(frame.agents[name].pose[3:])[None]


@pytest.mark.slow
def test_episode_ends_with_the_frames_and_repeats_with_its_seed(tracking: BeamTracking) -> None:
    def run() -> list[float]:
        tracking.reset(seed=3)
        rewards, is_over = [], False
        while not is_over:
            _, reward, _, is_over, _ = tracking.step(np.int64(len(rewards)))
            rewards.append(reward)
        return rewards

    first = run()
    assert 6 <= len(first) <= 8 and first == run()
    with pytest.raises(InputError, match="last of the episode"):
        tracking.step(np.int64(0))
    with pytest.raises(InputError, match="a beam from 0 to 63"):
        tracking.step(np.int64(64))
    with pytest.raises(InputError, match="there is traffic_seed"):
        tracking.reset(options={"speed": 1})


@pytest.mark.slow
def test_change_of_station_costs_its_interruption(handover: Handover) -> None:
    rewards = {}
    for other in (0, 1):
        _, info = handover.reset(seed=1)
        serving = handover._serving
        _, rewards[other], _, _, info = handover.step(np.int64(serving if other == 0 else 1 - serving))
        rate = handover.link.spectral_efficiency(handover.link.snr(handover.frame, "cav_1", handover.peers)).max(axis=1)
        chosen = serving if other == 0 else 1 - serving
        assert rewards[other] == pytest.approx(rate[chosen] * (1.0 if other == 0 else 0.5))
        assert info["best_reward"] == pytest.approx(rate.max())


@pytest.mark.slow
def test_arguments_that_cannot_be_are_refused(tracking: BeamTracking) -> None:
    assert {"mmw/BeamTracking-v0", "mmw/Handover-v0"} <= set(gymnasium.registry)
    with pytest.raises(InputError, match=r"beam.*has an observation of this name"):
        BeamTracking(extra={"beam": IMAGE})
    with pytest.raises(InputError, match="two or more different"):
        Handover(peers=("rsu_1",))
    with pytest.raises(InputError, match="interruption_s = 1"):
        Handover(interruption_s=1.0)
    with pytest.raises(InputError, match="frames_per_step = 0"):
        BeamTracking(frames_per_step=0)
    with pytest.raises(InputError, match="there is none in frame"):
        RadioLink().snr(tracking.frame, "cav_1", ("rsu_9",))
    with pytest.raises(InputError, match=r"there is none|carrier"):
        RadioLink(carrier_hz=60e9).snr(tracking.frame, "cav_1", ("rsu_1",))


@pytest.mark.slow
def test_pettingzoo_finds_no_fault_and_speeds_are_obeyed() -> None:
    fleet = Fleet(overrides=("frames.count=90", "sensors=[]"), device="cpu")
    parallel_api_test(fleet, num_cycles=20)
    fleet.reset(seed=1)
    over: dict[str, bool] = {"cav_1": False}
    while not over["cav_1"]:
        observations, rewards, _, over, infos = fleet.step({name: np.array([0, 7]) for name in fleet.agents})
    speed = np.linalg.norm(observations["cav_2"]["velocity"])
    rate = fleet.link.spectral_efficiency(fleet.link.snr(fleet.frame, "cav_2", ("rsu_1",)))[0]
    assert rewards["cav_2"] == pytest.approx(rate[7] + 0.1 * speed) and infos["cav_2"]["best_rate"] >= rate[7]
    assert speed < 6.0 and fleet.agents == []  # braked from 6.6 m/s
    fleet.reset(seed=1)
    with pytest.raises(InputError, match="action of cav_2 = None"):
        fleet.step({"cav_1": np.array([0, 0])})
    fleet.close()
    with pytest.raises(InputError, match="each vehicle once"):
        Fleet(vehicles=("cav_1", "cav_1"))
