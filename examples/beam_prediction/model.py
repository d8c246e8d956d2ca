"""The predictor: a token a past frame, W query tokens behind them, GPT-2 over both, a head that names a beam for each.

All input sets share this code: without sensors the tokens hold the beam indices alone. The recurrent baseline is the
same network with a GRU in the place of GPT-2.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, cast

import torch
from torch import Tensor, nn

from examples.beam_prediction.config import ModelConfig
from examples.beam_prediction.data import Batch, BeamData
from examples.beam_prediction.encoders import SensorReader
from mmw.core.errors import InputError

Backbone = Literal["gpt2", "gru"]

HARMONICS = 8
"""Waves by which a token knows that beam Q - 1 is a neighbor of beam 0. Design value."""


CERTAIN = 4.0
"""Logit by which the last known beam leads before anything is learned: a network that knows nothing holds the beam.
Design value."""

HILL = 0.5
"""Standard deviation of the hill by which a beam is shown among the cells of a sample, in beams. Design value."""


class BeamPredictor(nn.Module):
    """Predict the beams of the next W frames from past beams and samples of sensors."""

    def __init__(self, config: ModelConfig, data: BeamData, sources: Sequence[str], backbone: Backbone = "gpt2"):
        """Make one.

        Args:
            config: Sizes, and how GPT-2 starts.
            data: Lengths of windows, size of the codebook, shapes of samples.
            sources: Sensors that it reads.
            backbone: `gpt2`, or `gru` for the baseline.

        Raises:
            InputError: If the folder of GPT-2's weights cannot be used.
        """
        super().__init__()
        self.beams, self.future, self.sensor_dropout = data.beams, data.future, config.sensor_dropout
        self.backbone = Gpt2(config, data.past + data.future) if backbone == "gpt2" else Gru(config)
        width = self.backbone.width
        self.waves: Tensor
        self.register_buffer("waves", beam_waves(data.beams), persistent=False)
        self.beam = nn.Embedding(data.beams + 1, width)
        self.wave = nn.Linear(2 * HARMONICS, width)
        self.age = nn.Embedding(data.every, width)
        self.sensors = {source: data.sensors[source] for source in sources}
        self.readers = nn.ModuleDict()
        for source, sensor in self.sensors.items():
            shape = sensor.samples.shape[1:]
            seen = config.crop_beams * shape[2] // data.beams if sensor.is_in_array else shape[2]
            self.readers[name_of(source)] = SensorReader(shape, config.channels, width, seen)
        self.queries = nn.Parameter(0.02 * torch.randn(data.future, width))
        self.norm = nn.LayerNorm(width)
        self.absolute = nn.Linear(width, data.beams)
        self.shift = nn.Linear(width, data.beams)
        for table in (self.beam, self.age):
            nn.init.normal_(table.weight, std=0.02)
        with torch.no_grad():
            self.shift.bias[0] = CERTAIN

    def forward(self, batch: Batch) -> Tensor:
        """Return the logits of the beams of the next frames, shape [B, W, Q].

        Two heads are added: one names beams, the other shifts from the last known beam. Samples of the roadside unit
        are seen from that beam too, so what is learned about motion in one direction holds for all.
        """
        last, is_known = last_beam(batch.beams, self.beams)
        tokens = self.beam(batch.beams) + self.wave(self.waves[batch.beams]) + self._read(batch, last)
        queries = self.queries.expand(len(tokens), -1, -1)
        hidden = self.norm(self.backbone(torch.cat([tokens, queries], dim=1))[:, -self.future :])
        place = (torch.arange(self.beams, device=last.device) - last[:, None]) % self.beams
        shifted = self.shift(hidden).gather(2, place[:, None].expand(-1, self.future, -1))
        return self.absolute(hidden) + shifted * is_known[:, None, None]

    def _read(self, batch: Batch, last: Tensor) -> Tensor:
        """Return the sum of sensor tokens at each past frame, shape [B, P, width], or 0 without any."""
        read = torch.zeros((), device=last.device)
        weights = self._modality_weights(len(last), last.device)
        for source, sensor in self.sensors.items():
            samples, reader = batch.samples[source], cast(SensorReader, self.readers[name_of(source)])
            center, hint = torch.zeros_like(last), torch.zeros((), device=last.device)
            if sensor.is_in_array:
                center = last * (samples.shape[-1] // self.beams)
                reach = reader.columns * self.beams / samples.shape[-1]
                hint = hills(batch.sample_beams, last, self.beams, reader.cells, reach)
            token = reader(samples, batch.references[source], center, hint.expand(*samples.shape[:2], reader.cells))
            held = token.gather(1, batch.slot[..., None].expand(-1, -1, token.shape[2]))
            read = read + (held + self.age(batch.age)) * weights[sensor.modality]
        return read

    def _modality_weights(self, count: int, device: torch.device) -> dict[str, Tensor]:
        """Return 1 or 0 for each modality and window, shape [B, 1, 1]; in training some windows lack a modality."""
        share = self.sensor_dropout if self.training else 0.0
        return {
            modality: (torch.rand(count, 1, 1, device=device) >= share).float()
            for modality in dict.fromkeys(sensor.modality for sensor in self.sensors.values())
        }


class Gpt2(nn.Module):
    """GPT-2 over tokens that are vectors already."""

    def __init__(self, config: ModelConfig, length: int):
        """Make one.

        Args:
            config: Sizes, or a folder of weights whose first layers are used.
            length: Tokens of a sequence.

        Raises:
            InputError: If the folder of weights is not there, or its model is too short.
        """
        super().__init__()
        from transformers import GPT2Config, GPT2Model

        if config.weights is None:
            rate = config.dropout
            self.model = GPT2Model(
                GPT2Config(
                    vocab_size=1, n_positions=length, n_embd=config.width, n_layer=config.layers, n_head=config.heads,
                    resid_pdrop=rate, embd_pdrop=rate, attn_pdrop=rate, bos_token_id=None, eos_token_id=None,
                )
            )  # fmt: skip
        else:
            if not (Path(config.weights) / "config.json").is_file():
                raise InputError(
                    f"model.weights = {config.weights}: no GPT-2 is there (config.json and model.safetensors); give "
                    "its folder, or model.weights=null model.random_init=true"
                )
            self.model = GPT2Model.from_pretrained(config.weights, local_files_only=True)
            if len(self.model.h) < config.layers or self.model.config.n_positions < length:
                raise InputError(
                    f"model.weights = {config.weights}: {len(self.model.h)} layers for {self.model.config.n_positions} "
                    f"tokens; {config.layers} and {length} are needed; lower model.layers, or shorten windows"
                )
            self.model.h = self.model.h[: config.layers]
            self.model.set_input_embeddings(nn.Embedding(1, self.model.config.n_embd))
        self.width: int = self.model.config.n_embd
        self.model.wte.requires_grad_(False)  # words have no use here
        if config.freeze:
            for name, parameter in self.model.named_parameters():
                parameter.requires_grad_(".ln_" in name or name.startswith(("ln_f", "wpe")))

    def forward(self, tokens: Tensor) -> Tensor:
        """Return the last layer's states, each of which sees the tokens up to its own, shape [B, L, width]."""
        return self.model(inputs_embeds=tokens, use_cache=False).last_hidden_state


class Gru(nn.Module):
    """A recurrent network over the same tokens."""

    def __init__(self, config: ModelConfig):
        """Make one."""
        super().__init__()
        self.width = config.gru_width
        self.model = nn.GRU(self.width, self.width, config.gru_layers, batch_first=True)

    def forward(self, tokens: Tensor) -> Tensor:
        """Return the last layer's states, shape [B, L, width]."""
        return self.model(tokens)[0]


def beam_waves(beams: int) -> Tensor:
    """Return sines and cosines of every beam's place on the circle of beams, 0 for no beam, shape [Q + 1, 2 n]."""
    turn = 2 * math.pi * torch.outer(torch.arange(beams), torch.arange(1, HARMONICS + 1)) / beams
    waves = torch.cat([turn.sin(), turn.cos()], dim=1)
    return torch.cat([waves, torch.zeros(1, 2 * HARMONICS)])


def hills(found: Tensor, last: Tensor, beams: int, cells: int, reach: float) -> Tensor:
    """Return where beams lie among cells around another one, a hill for each, nothing for no beam, shape [B, S, cells].

    Args:
        found: The beams, `beams` for none, shape [B, S].
        last: Beam in the middle of the cells, shape [B].
        beams: Size of the codebook.
        cells: How many cells there are.
        reach: Beams that all cells are wide.
    """
    place = ((torch.arange(cells, device=last.device) + 0.5) / cells - 0.5) * reach
    shift = (found - last[:, None] + beams // 2) % beams - beams // 2
    return torch.exp(-0.5 * ((place - shift[..., None]) / HILL) ** 2) * (found < beams)[..., None]


def last_beam(past: Tensor, beams: int) -> tuple[Tensor, Tensor]:
    """Return the latest beam of windows, 0 where there was none, shape [B], and whether there was one, shape [B].

    Args:
        past: Beams of past frames, `beams` for none, shape [B, P].
        beams: Size of the codebook.
    """
    is_there = past < beams
    place = (is_there * torch.arange(1, past.shape[1] + 1, device=past.device)).argmax(dim=1)
    is_known = is_there.any(dim=1)
    return torch.where(is_known, past.gather(1, place[:, None])[:, 0], 0), is_known


def name_of(source: str) -> str:
    """Return a sensor's name as a module may have it."""
    return source.replace("/", "_")
