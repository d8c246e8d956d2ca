"""Rates, phases and times of sensors and the channel: which frames have a sample, and what is refused."""

from typing import Any

import numpy as np
import pytest

from mmw.config import Config, ConfigError, load_config
from mmw.config.sampling import Sampling

STAGE: dict[str, Any] = {"scenarios": [{"name": "s", "stage": "s.usda"}], "sensors": [{"type": "imu"}]}


def configuration(frames: dict, **more: Any) -> Config:
    return load_config({**STAGE, "frames": frames, **more})


@pytest.mark.parametrize(
    ("keys", "rate", "due"),
    [
        ({}, 100, list(range(12))),
        ({"rate_hz": 50}, 100, [0, 2, 4, 6, 8, 10]),
        ({"rate_hz": 33.33}, 100, [0, 3, 6, 9]),
        ({"rate_hz": 250, "phase_s": 0.002}, 1000, [2, 6, 10]),
        ({"rate_hz": 250}, 250, list(range(12))),
        ({"sample_times_s": [0.0, 0.003, 0.011]}, 1000, [0, 3, 11]),
        ({"sample_times_s": [0.1, 0.7]}, 10, [1, 7]),
    ],
)
def test_frames_that_have_a_sample(keys: dict, rate: int, due: list[int]) -> None:
    sampling = Sampling(**keys)
    assert np.flatnonzero(sampling.is_due(range(12), rate)).tolist() == due
    assert sampling.takes_all(rate) == (len(due) == 12)


def test_without_a_rate_every_frame_has_a_sample() -> None:
    assert configuration({"count": 3}).sensors[0].rate_hz == 100.0
    fast = configuration({"count": 3, "rate_hz": 1000})
    assert fast.sensors[0].rate_hz == 1000.0 and fast.channel.period_frames(1000) == 1
    scenarios = [
        {"name": n, "stage": "s.usda", "frames": {"count": 2, "rate_hz": r}} for n, r in (("a", 10), ("b", 250))
    ]
    both = load_config({**STAGE, "scenarios": scenarios})
    assert [both.frame_rate_of(one) for one in both.scenarios] == [10, 250]
    assert both.sensors[0].rate_hz is None and both.sensors[0].period_frames(250) == 1
    same = load_config({**STAGE, "scenarios": scenarios, "frames": {"count": 7}})  # the rate is the scenarios'
    assert [same.frame_rate_of(one) for one in same.scenarios] == [10, 250]
    assert [same.frames_of(one).count for one in same.scenarios] == [7, 7]


def test_configurations_without_these_keys_keep_their_identity() -> None:
    """The hash of a configuration is in every dataset: what is not given is left out of it."""
    dumped = load_config("quickstart").identity()
    for section in (*dumped["sensors"], dumped["channel"]):
        assert not {"phase_s", "sample_times_s"} & set(section)
    assert "rate_hz" not in dumped["channel"] and "rate_hz" not in dumped["frames"]
    assert [sensor["rate_hz"] for sensor in dumped["sensors"]] == [100.0] * 5 + [10.0] * 4  # as it was


def test_a_stored_configuration_is_read_as_it_was() -> None:
    config = configuration(
        {"count": 50, "rate_hz": 1000},
        channel={"rate_hz": 500, "phase_s": 0.001},
        sensors=[{"type": "imu", "rate_hz": 200}, {"type": "gnss", "sample_times_s": [0.01, 0.02]}],
    )
    assert load_config(config.model_dump(mode="json")) == config
    assert config.sha256() != configuration({"count": 50, "rate_hz": 1000}).sha256()


@pytest.mark.parametrize(
    ("frames", "more", "said"),
    [
        ({"rate_hz": 30}, {}, r"frames.rate_hz = 30: .*; give 25 or 40"),
        ({"rate_hz": 1000}, {"channel": {"rate_hz": 300}}, r"channel.rate_hz = 300: .*; give 333.333 or 250"),
        ({}, {"channel": {"rate_hz": 200}}, r"channel.rate_hz = 200: .*; give at most 100, or raise frames.rate_hz"),
        ({}, {"sensors": [{"type": "imu", "rate_hz": 40}]}, r"sensors\[0\].rate_hz = 40: .*; give 50 or 33.3333"),
        ({}, {"channel": {"phase_s": 0.01}}, r"channel.phase_s = 0.01: .* period, 0.01 s; give 0 to 0$"),
        ({}, {"channel": {"rate_hz": 20, "phase_s": 0.015}}, r"phase_s = 0.015: .*; give 0.01 or 0.02"),
        ({}, {"channel": {"rate_hz": 20, "phase_s": 0.05}}, r"phase_s = 0.05: .* 0.05 s; give 0 to 0.04"),
        ({"count": 10}, {"channel": {"sample_times_s": [0.05, 3]}}, r"holds 3: the frames are from 0 to 0.09 s"),
        ({}, {"channel": {"sample_times_s": [0.005]}}, r"sample_times_s = 0.005: .*; give 0 or 0.01"),
        ({}, {"channel": {"sample_times_s": [0.02, 0.01]}}, r"growing times from 0 on are needed"),
        ({}, {"channel": {"sample_times_s": [0.01], "rate_hz": 10}}, r"sample_times_s and rate_hz are both given"),
        ({}, {"channel": {"sample_times_s": [0.01], "phase_s": 0.1}}, r"sample_times_s and phase_s are both given"),
    ],
)
def test_what_does_not_fit_is_one_line_with_what_would(frames: dict, more: dict, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as error:
        configuration(frames, **more)
    assert len(error.value.problems) == 1 and "\n" not in str(error.value)


def test_a_channel_that_is_off_needs_no_rate_that_fits() -> None:
    assert not configuration({"rate_hz": 10}, channel={"enabled": False, "rate_hz": 300}).channel.enabled
