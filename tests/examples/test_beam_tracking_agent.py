"""The agent that tracks beams: replayed drives are the environment's, methods against closed forms, a small run."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install 'multimodal-wireless[gym]'")
pytest.importorskip("pettingzoo", reason="PettingZoo is not installed: pip install 'multimodal-wireless[gym]'")

from gymnasium.utils.env_checker import check_env
from PIL import Image

from examples.beam_tracking_agent.__main__ import FIRST_TEST, draw, main, summary
from examples.beam_tracking_agent.drives import Drive, Replay, features, make_environment, read_drives, record
from examples.beam_tracking_agent.methods import baselines, follow, held, interval, nearest
from mmw.core.errors import InputError

BEAMS = 8


def passing(start: float, steps: int = 40) -> Drive:
    """Return a drive along a line past the station, whose best beam is the eighth of a half turn that it is in."""
    y = start + 1.0 * np.arange(steps)
    position = np.stack([np.full(steps, 10.0), y, np.zeros(steps)], axis=1).astype(np.float32)
    best = np.floor((np.arctan2(y, 10.0) / np.pi + 0.5) * BEAMS)
    rates = np.exp(-np.abs(np.arange(BEAMS) - best[:, None])).astype(np.float32)
    velocity = np.tile(np.float32([0.0, 10.0, 0.0]), (steps, 1))
    return Drive(rates, 10.0 * np.log10(rates), position, velocity)


def test_an_interval_is_that_of_student() -> None:
    mean, low, high = interval(np.array([1.0, 2.0, 3.0]))
    half = 4.302653 / np.sqrt(3.0)  # quantile of 97.5 % with two degrees of freedom, standard deviation 1
    assert (mean, low, high) == pytest.approx((2.0, 2.0 - half, 2.0 + half), rel=1e-6)


def test_methods_against_what_they_are() -> None:
    drive, other = passing(-20.0), passing(-19.6)
    best = drive.rates.argmax(axis=1)
    assert held(drive, 1).tolist() == drive.rates[np.arange(1, 40), best[:-1]].tolist()
    swept = [best[0]] * 10 + [best[10]] * 10 + [best[20]] * 10 + [best[30]] * 9
    assert held(drive, 10).tolist() == drive.rates[np.arange(1, 40), swept].tolist()
    # A vehicle of 10 m/s is 1 m further in the next step, where the table has its place.
    assert nearest(drive, drive.position, best).tolist() == [1.0] * 39
    scores = baselines([drive], [[drive], [other, drive]])
    assert scores["exhaustive search"].tolist() == [1.0, 1.0] and scores["nearest position"][0] == 1.0
    assert scores["random beam"][0] == pytest.approx(drive.rates[1:].mean())
    assert all((one <= 1.0).all() and one.shape == (2,) for one in scores.values())
    assert scores["hold-last, sweep every 1 s"][0] < scores["hold-last, sweep every 0.1 s"][0] < 1.0


def test_a_policy_is_followed_on_its_own_beams() -> None:
    drives = [[passing(-20.0)], [passing(-10.0), passing(0.0)]]
    seen = []

    def same_beam(states: np.ndarray) -> np.ndarray:
        seen.append(states)
        return states[:, :BEAMS].argmax(axis=1)

    expected = [np.mean([drive.rates[1:, 0].mean() for drive in some]) for some in drives]
    assert follow(same_beam, drives) == pytest.approx(expected)
    assert np.stack(seen).shape == (39, 3, BEAMS + 20) and np.isfinite(seen).all()
    assert seen[5][1, BEAMS] == pytest.approx(drives[1][0].snr_db[5, 0] / 20.0)


def test_episodes_are_parts_of_drives() -> None:
    env = Replay([passing(-20.0), passing(-10.0)], steps=12)
    check_env(env, skip_render_check=True)
    starts = set()
    for seed in range(8):
        env.reset(seed=seed)
        start, rewards, is_over = env.t, [], False
        while not is_over:
            _, reward, _, is_over, _ = env.step(np.int64(3))
            rewards.append(reward)
        assert rewards == env.drive.rates[start + 1 : start + 13, 3].tolist()
        starts.add(start)
    assert len(starts) > 3


def test_picture_and_numbers() -> None:
    taken = np.array([0, 500, 1000])
    scores = np.linspace(0.1, 0.9, 3)[None, :, None] + np.array([0.0, 0.02, 0.04])[:, None, None] + np.zeros((3, 3, 2))
    scores[..., 1] += 0.05
    others = baselines([passing(-20.0)], [[passing(-18.0)], [passing(-9.5)]])
    left, right = draw(taken, scores, others).axes
    assert len(right.containers) == 6 and "agent, 3 training seeds" in left.get_legend_handles_labels()[1]
    assert left.lines[0].get_ydata()[-1] == pytest.approx(0.945)
    numbers = summary(taken, scores, others)
    assert numbers["agent"][-1][0] == 0.945 and numbers["steps"] == [0, 500, 1000]
    lead, _, _ = numbers["lead"]["random beam"]
    assert lead == pytest.approx(0.945 - others["random beam"].mean(), abs=1e-3)


def test_too_few_for_an_interval_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--seeds 1"):
        main(["--out", str(tmp_path), "--seeds", "1"])


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with drives of 0.5 s."""
    folder = tmp_path_factory.mktemp("agent")
    read_drives((1, FIRST_TEST, FIRST_TEST + 1), 50, folder / "drives")
    return folder


@pytest.mark.slow
def test_a_replayed_drive_is_the_episode_of_the_environment(out: Path) -> None:
    (drives,) = read_drives((1,), 50, out / "drives")
    env = make_environment(50)
    (first, *_), beams = record(env, 1), [5, 60, 31]
    for kept, again in zip(drives[0], first, strict=True):
        assert np.array_equal(kept, again)
    env.reset(options={"traffic_seed": 1})
    replay = Replay(drives[:1], 3)
    replay.reset(seed=0)
    assert len(drives[0].rates) >= 4
    replay.t, replay.stop = 0, 3
    for t, beam in enumerate(beams, 1):
        observation, reward, _, _, _ = env.step(np.int64(beam))
        seen, replayed, *_ = replay.step(np.int64(beam))
        assert replayed == np.float32(reward)
        expected = drives[0].observe(t, beam)
        assert all(np.array_equal(observation[name], value) for name, value in expected.items())
        assert np.array_equal(seen, features(observation, 64))
    env.close()


@pytest.mark.slow
def test_an_agent_learns_a_simple_task() -> None:
    pytest.importorskip("stable_baselines3", reason="install multimodal-wireless[rl]")
    from examples.beam_tracking_agent.training import train

    known, unseen = [passing(start) for start in (-20.0, -19.3, -18.8)], [[passing(-19.0)], [passing(-19.6)]]
    taken, scores, agent = train(known, unseen, steps=6000, looks=3, seed=0)
    chance = np.mean([drive.rates.mean() for (drive,) in unseen])
    assert taken[0] == 0 and taken[-1] >= 6000 and scores.shape == (4, 2)
    assert scores[-1].mean() > 0.5 + 0.5 * chance
    assert np.allclose(follow(lambda seen: agent.predict(seen, deterministic=True)[0], unseen), scores[-1])


@pytest.mark.slow
def test_a_small_run_from_the_command_line(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("stable_baselines3", reason="install multimodal-wireless[rl]")
    sizes = "--steps 320 --looks 2 --seeds 2 --train 1 --test 2 --frames 50"
    main(["--out", str(out), *sizes.split()])
    told = capsys.readouterr().out
    assert "training seed 1" in told and "nearest position" in told and "traced" not in told
    numbers = json.loads((out / "curve.json").read_text())
    assert np.shape(numbers["agent_each_seed"]) == (2, 3) and (out / "agent_1.zip").is_file()
    best = numbers["traffic_seeds"]["exhaustive search"][0]
    assert all(0.0 < values[0] <= best for values in numbers["traffic_seeds"].values())
    picture = np.asarray(Image.open(out / "curve.png").convert("RGB"))
    assert picture.shape[0] > 300 and picture.std() > 10
