"""Configuration of the experiment: windows, splits, sensor features, model, training and the matrix of runs.

`experiment.yaml` is the experiment, `smoke.yaml` the same in small; `key=value` on the command line replaces values.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, field_validator, model_validator

from mmw.config.section import Section
from mmw.config.yaml_file import ConfigError, read_yaml, reason_of, validated
from mmw.config.yaml_loader import parse_yaml
from mmw.core.errors import InputError

InputSet = Literal["index", "lidar", "camera", "all"]

INPUTS: dict[InputSet, tuple[str, ...]] = {
    "index": (),
    "lidar": ("lidar",),
    "camera": ("camera",),
    "all": ("lidar", "camera"),
}
"""Input set -> sensor modalities that come to the past beam indices."""


class RadioConfig(Section):
    """The link whose beams are predicted; the paper's values."""

    carrier_hz: float = Field(28e9, gt=0, description="carrier [Hz]")
    tx_antennas: int = Field(64, ge=1, description="elements of the roadside unit's linear array (count)")
    rx_antennas: int = Field(16, ge=1, description="elements of the vehicle's linear array (count)")
    beams: int = Field(64, ge=2, le=255, description="beams of both DFT codebooks, Q (count)")
    subcarriers: int = Field(1024, ge=1, description="subcarriers that H is averaged over (count)")
    spacing_hz: float = Field(120e3, gt=0, description="distance between subcarriers [Hz]")


class FeatureConfig(Section):
    """Sensors, and the preparation of their sweeps and images before training (`features.py`)."""

    every_frames: int = Field(
        10, ge=1, description="frames from one sample to the next, which is held in between (count)"
    )
    lidar: tuple[str, ...] = Field(("rsu/lidar",), description="LiDARs as role/sensor, role cav or rsu (list)")
    camera: tuple[str, ...] = Field(("rsu/front",), description="cameras as role/sensor (list)")
    columns_per_beam: int = Field(4, ge=1, description="columns of a feature that a beam is wide (count)")
    ranges: int = Field(64, ge=16, description="rows of a sweep, from the sensor outwards (count)")
    range_m: float = Field(120.0, gt=0, description="outer edge of the last row [m]")
    elevations: int = Field(48, ge=16, description="rows of an image (count)")

    @field_validator("lidar", "camera")
    @classmethod
    def _sources(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for source in value:
            role, _, sensor = source.partition("/")
            if role not in ("cav", "rsu") or not sensor:
                raise InputError(f"{source!r} is no sensor; write role/sensor, such as rsu/lidar or cav/front")
        if len(set(value)) < len(value):
            raise InputError(f"{list(value)} names a sensor twice; name each once")
        return value

    def sources(self, modality: str) -> tuple[str, ...]:
        """Return the sensors of a modality, `lidar` or `camera`."""
        return {"lidar": self.lidar, "camera": self.camera}[modality]


class WindowConfig(Section):
    """Windows of P past and W future frames at 100 Hz, and how they are split."""

    weathers: tuple[str, ...] = Field(("sunny",), min_length=1, description="weathers that are used (list)")
    past: int = Field(40, ge=2, description="past frames P (count)")
    future: int = Field(10, ge=1, description="predicted frames W (count)")
    stride: int = Field(1, ge=1, description="frames from one window of a vehicle to the next (count)")
    split: Literal["track", "scenario", "town", "window"] = Field(
        "track", description="what goes to one part: stretches of time of every scenario, whole scenarios or towns; or"
        " single windows at random, whose neighbors of a hundredth of a second are in the other part (name)"
    )  # fmt: skip
    train: float = Field(5.65, gt=0, description="share of training (ratio)")
    val: float = Field(1.0, gt=0, description="share of validation (ratio)")
    gap: int = Field(0, ge=0, description="split by track: frames between two parts that no window uses (count)")
    seed: int = Field(0, ge=0, description="decides which stretch or scenario goes where (number)")


class ModelConfig(Section):
    """The network. GPT-2 small is 768 wide with 12 heads and 12 layers."""

    random_init: bool = Field(False, description="start GPT-2 from random numbers instead of `weights` (true or false)")
    weights: str | None = Field(None, description="folder of pre-trained GPT-2 weights on this machine (path)")
    freeze: bool = Field(
        False, description="with `weights`: train only layer norms and positions of GPT-2 (true or false)"
    )
    layers: int = Field(6, ge=1, description="layers of GPT-2, of `weights` the first ones (count)")
    width: int = Field(768, ge=8, description="width of a token; that of `weights` where these are used (count)")
    heads: int = Field(12, ge=1, description="attention heads; those of `weights` where these are used (count)")
    dropout: float = Field(0.1, ge=0, lt=1, description="dropout of GPT-2 (probability)")
    channels: tuple[int, ...] = Field(
        (16, 32, 64, 128), min_length=1, description="channels of a sensor's encoder, each halves the sides (list)"
    )
    crop_beams: int = Field(
        32, ge=2, description="beams around the last one that are seen of the roadside unit's sensors (count)"
    )
    sensor_dropout: float = Field(
        0.2, ge=0, lt=1, description="windows that are trained without one of their modalities (probability)"
    )
    gru_width: int = Field(256, ge=8, description="width of the recurrent baseline (count)")
    gru_layers: int = Field(2, ge=1, description="layers of the recurrent baseline (count)")

    @model_validator(mode="after")
    def _start_is_stated(self) -> "ModelConfig":
        if self.random_init == (self.weights is not None):
            raise InputError(
                f"random_init = {str(self.random_init).lower()} with weights = {self.weights}; GPT-2 starts either "
                "from a folder of weights or, with random_init=true, from random numbers; give one of the two"
            )
        if self.freeze and self.random_init:
            raise InputError("freeze = true with random_init; random layers cannot stay as they are; drop freeze")
        if self.width % self.heads:
            raise InputError(f"width = {self.width}, heads = {self.heads}; heads must divide the width; change one")
        return self


class TrainingConfig(Section):
    """Training of every run; nothing is chosen by validation: the last epoch counts."""

    epochs: int = Field(10, ge=1, description="rounds through the training windows (count)")
    batch: int = Field(512, ge=1, description="windows of a step (count)")
    learning_rate: float = Field(
        3e-4, gt=0, description="peak step size of AdamW, which falls to 0 by a cosine (number)"
    )
    warmup: float = Field(0.05, ge=0, lt=1, description="share of the steps in which the step size grows (ratio)")
    weight_decay: float = Field(0.05, ge=0, description="AdamW's, of matrices alone (number)")
    loss: Literal["gain", "beam"] = Field(
        "gain", description="minus the logarithm of the expected gain, or the best beam's cross entropy (name)"
    )
    mirror: bool = Field(
        True, description="mirror windows at random: left for right (beam q for -q), front for back (true or false)"
    )
    clip: float = Field(1.0, gt=0, description="largest norm of a gradient (number)")
    precision: Literal["bf16", "fp32"] = Field("bf16", description="arithmetic of the forward pass (name)")
    checkpoint_s: float = Field(30.0, ge=0, description="time between two checkpoints at least [s]")
    compile: bool = Field(False, description="compile GPT-2 with torch.compile (true or false)")


class Experiment(Section):
    """One configuration file."""

    radio: RadioConfig = Field(default_factory=RadioConfig, description="link and codebooks (section)")
    features: FeatureConfig = Field(default_factory=FeatureConfig, description="sensors (section)")
    windows: WindowConfig = Field(default_factory=WindowConfig, description="windows and splits (section)")
    model: ModelConfig = Field(description="network (section)")
    training: TrainingConfig = Field(default_factory=TrainingConfig, description="optimisation (section)")
    inputs: tuple[InputSet, ...] = Field(tuple(INPUTS), description="input sets that are trained (list)")
    gru: bool = Field(True, description="train the recurrent baseline too (true or false)")
    seeds: tuple[int, ...] = Field((0, 1, 2), min_length=1, description="seeds of every input set (list)")


def load_experiment(path: str | Path, overrides: Sequence[str] = ()) -> Experiment:
    """Return the experiment of a file.

    Args:
        path: YAML file.
        overrides: `section.key=value`, values as YAML.

    Raises:
        ConfigError: If the file, an override or a value cannot be used.
    """
    data = read_yaml(Path(path), "a map with the key `model`")
    for item in overrides:
        key, sign, text = item.partition("=")
        *parents, last = key.split(".")
        here: Any = data
        for part in parents:
            here = here.setdefault(part, {}) if isinstance(here, dict) else None
        if not sign or not last or not isinstance(here, dict):
            raise ConfigError([f"override {item!r}: write it as section.key=value, such as training.epochs=2"])
        try:
            here[last] = parse_yaml(text)
        except yaml.YAMLError as error:
            raise ConfigError([f"override {item!r}: the value is not valid YAML ({reason_of(error)})"]) from None
    return validated(Experiment, data, Path(path))


def fingerprint(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of JSON values, whatever their order."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
