"""One run: one input set, one seed, trained for a fixed number of epochs, with checkpoints.

Whatever is random is a function of (seed, epoch), so a run that was stopped goes on to the same numbers.

    OUT/NAME/run.json           what is trained
    OUT/NAME/history.jsonl      a line an epoch
    OUT/NAME/checkpoint.pt      while it trains: weights, optimizer, history
    OUT/NAME/weights.pt         at the end
    OUT/NAME/predictions.npz    `beams`, the five likeliest beams of every validation window and step
    OUT/NAME/metrics.json       written last: scores, time, sizes
"""

import io
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from examples.beam_prediction.cache import sources_of
from examples.beam_prediction.config import INPUTS, Experiment, TrainingConfig, fingerprint
from examples.beam_prediction.data import BeamData
from examples.beam_prediction.metrics import LIKELY, score
from examples.beam_prediction.model import Backbone, BeamPredictor
from mmw.core.errors import InputError
from mmw.storage.atomic_files import write_bytes_atomically

METRICS = "metrics.json"
PREDICTIONS = "predictions.npz"
CHECKPOINT = "checkpoint.pt"
MIN_GAIN = 1e-6
"""Smaller normalized gains count as this, so that its logarithm is finite. Design value."""


@dataclass(frozen=True)
class Run:
    """One input set and seed to train."""

    inputs: str
    """A name of `INPUTS`."""
    seed: int
    backbone: Backbone = "gpt2"

    @property
    def name(self) -> str:
        """Its folder."""
        return f"{self.label}-{self.seed}"

    @property
    def label(self) -> str:
        """Method of the comparison: the input set, or `gru`."""
        return "gru" if self.backbone == "gru" else self.inputs


def runs_of(experiment: Experiment) -> list[Run]:
    """Return all runs, seed by seed, so that a part of them compares all input sets already."""
    runs = []
    for seed in experiment.seeds:
        runs += [Run("index", seed, "gru")] if experiment.gru else []
        runs += [Run(inputs, seed) for inputs in experiment.inputs]
    return runs


def train(run: Run, experiment: Experiment, data: BeamData, out: Path, deadline: float = math.inf) -> bool:
    """Train one run, from its checkpoint if there is one, and write its predictions.

    Args:
        run: Input set and seed.
        experiment: Model and training of it count.
        data: The data.
        out: Folder of all runs.
        deadline: `time.monotonic()` after which no further epoch begins.

    Returns:
        True if the run is finished, False if the deadline came first.

    Raises:
        InputError: If the folder holds a run of another experiment.
    """
    folder, config = out / run.name, experiment.training
    _take_up(folder, run, experiment, data)
    if (folder / METRICS).is_file():
        return True
    sources = [source for source, modality in sources_of(experiment).items() if modality in INPUTS[run.inputs]]
    torch.manual_seed(run.seed)
    model = BeamPredictor(experiment.model, data, sources, run.backbone).to(data.device)
    if config.compile:
        model.backbone.compile()
    optimizer = make_optimizer(model, config, data.device)
    history, saved = _resume(folder, model, optimizer, data.device), time.monotonic()
    for epoch in range(len(history), config.epochs):
        history.append(train_epoch(model, optimizer, data, sources, config, run.seed, epoch))
        print(f"{run.name} {_line(history[-1], config.epochs)}", flush=True)
        write_bytes_atomically(folder / "history.jsonl", "".join(json.dumps(row) + "\n" for row in history).encode())
        now = time.monotonic()
        if now > deadline or now - saved >= config.checkpoint_s:
            _save(folder, model, optimizer, history)
            saved = now
        if now > deadline and epoch + 1 < config.epochs:
            return False
    finish(folder, run, model, data, sources, config, history)
    return True


def train_epoch(
    model: BeamPredictor,
    optimizer: torch.optim.Optimizer,
    data: BeamData,
    sources: Sequence[str],
    config: TrainingConfig,
    seed: int,
    epoch: int,
) -> dict[str, float]:
    """Train one round through the windows and return what came of it, validation included."""
    begin = time.monotonic()
    torch.manual_seed(1_000_003 * (seed + 1) + epoch)
    order = torch.randperm(len(data.starts["train"])).to(data.device)
    steps = math.ceil(len(order) / config.batch)
    losses = []
    model.train()
    for step, some in enumerate(order.split(config.batch)):
        starts = data.starts["train"][some]
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * schedule(epoch * steps + step, config.epochs * steps, config.warmup)
        mirrored = (torch.rand(len(starts), 2) < 0.5).to(data.device) if config.mirror else None
        with precision(config, data.device):
            logits = model(data.batch(starts, sources, mirrored))
        loss = LOSSES[config.loss](logits, data.targets(starts, mirrored), data.target_gains(starts, mirrored))
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), config.clip)
        optimizer.step()
        losses.append(loss.detach())
    trained = time.monotonic() - begin
    predicted, val_loss = predict(model, data, sources, config)
    scores = validate(predicted, data)
    return {
        "epoch": epoch + 1,
        "loss": float(torch.stack(losses).mean()),
        "val_loss": val_loss,
        "gain": float(np.mean(scores["gain"])),
        "top1": float(np.mean(scores["top1"])),
        "seconds": time.monotonic() - begin,
        "windows_per_s": len(order) / trained,
    }


def beam_loss(logits: Tensor, target: Tensor, gains: Tensor) -> Tensor:
    """Return the cross entropy of the best beams, mean over frames with a path.

    Args:
        logits: Shape [B, W, Q].
        target: Best beams, -1 without any path, shape [B, W].
        gains: Not used.
    """
    total = functional.cross_entropy(logits.float().flatten(0, 1), target.flatten(), ignore_index=-1, reduction="sum")
    return total / (target >= 0).sum().clamp(min=1)


def gain_loss(logits: Tensor, target: Tensor, gains: Tensor) -> Tensor:
    """Return -log sum_q p(q) G(q), mean over frames with a path: two beams that gain the same are both right.

    Args:
        logits: Shape [B, W, Q].
        target: Best beams, -1 without any path, shape [B, W].
        gains: Normalised gain of every beam, shape [B, W, Q].
    """
    is_there = target >= 0
    log_gain = torch.log(gains.where(is_there[..., None], torch.ones(())).clamp(min=MIN_GAIN))
    loss = -torch.logsumexp(logits.float().log_softmax(dim=2) + log_gain, dim=2)
    return (loss * is_there).sum() / is_there.sum().clamp(min=1)


LOSSES = {"beam": beam_loss, "gain": gain_loss}


@torch.no_grad()
def predict(
    model: BeamPredictor, data: BeamData, sources: Sequence[str], config: TrainingConfig
) -> tuple[np.ndarray, float]:
    """Return the likeliest beams of every validation window, shape [n, W, 5], uint8, and the loss."""
    model.eval()
    found, total, count = [], 0.0, 0
    for starts in data.starts["val"].split(config.batch):
        with precision(config, data.device):
            logits = model(data.batch(starts, sources)).float()
        target = data.targets(starts)
        frames = int((target >= 0).sum())
        loss = LOSSES[config.loss](logits, target, data.target_gains(starts))
        total, count = total + float(loss) * frames, count + frames
        found.append(logits.topk(min(LIKELY, data.beams), dim=2).indices.byte().cpu())
    return torch.cat(found).numpy(), total / max(count, 1)


def validate(predicted: np.ndarray, data: BeamData) -> dict[str, list[float]]:
    """Return the scores of predictions for the validation windows, a list of W steps each."""
    frames = data.future_frames(data.starts["val"])
    return score(predicted, data.tx_beam[frames].cpu().numpy(), data.gains[frames].cpu().numpy()).rows()


def make_optimizer(model: nn.Module, config: TrainingConfig, device: torch.device) -> torch.optim.AdamW:
    """Return AdamW, whose weight decay is for matrices alone."""
    trained = [parameter for parameter in model.parameters() if parameter.requires_grad]
    groups = [
        {"params": [p for p in trained if p.ndim >= 2], "weight_decay": config.weight_decay},
        {"params": [p for p in trained if p.ndim < 2], "weight_decay": 0.0},
    ]
    return torch.optim.AdamW(groups, lr=config.learning_rate, betas=(0.9, 0.95), fused=device.type == "cuda")


def schedule(step: int, steps: int, warmup: float) -> float:
    """Return the share of the peak step size: a line up, then a cosine down to 0."""
    rise = warmup * steps
    if step < rise:
        return (step + 1) / rise
    return 0.5 * (1.0 + math.cos(math.pi * (step - rise) / max(steps - rise, 1)))


def precision(config: TrainingConfig, device: torch.device) -> torch.autocast:
    """Return the context of the forward pass."""
    return torch.autocast(device.type, dtype=torch.bfloat16, enabled=config.precision == "bf16")


def finish(
    folder: Path,
    run: Run,
    model: BeamPredictor,
    data: BeamData,
    sources: Sequence[str],
    config: TrainingConfig,
    history: list[dict[str, float]],
) -> None:
    """Write weights, predictions and scores of a trained run, and remove its checkpoint."""
    predicted, _ = predict(model, data, sources, config)
    write_bytes_atomically(folder / "weights.pt", torch_bytes(model.state_dict()))
    buffer = io.BytesIO()
    np.savez_compressed(buffer, beams=predicted)
    write_bytes_atomically(folder / PREDICTIONS, buffer.getbuffer())
    metrics = {
        "label": run.label,
        "seed": run.seed,
        "windows": {part: len(starts) for part, starts in data.starts.items()},
        "parameters": sum(p.numel() for p in model.parameters() if p.requires_grad),
        "seconds": sum(row["seconds"] for row in history),
        "history": history,
        "scores": validate(predicted, data),
    }
    write_bytes_atomically(folder / METRICS, json.dumps(metrics, indent=1).encode())
    (folder / CHECKPOINT).unlink(missing_ok=True)


def torch_bytes(content: Any) -> memoryview:
    """Return what `torch.save` writes."""
    buffer = io.BytesIO()
    torch.save(content, buffer)
    return buffer.getbuffer()


def _take_up(folder: Path, run: Run, experiment: Experiment, data: BeamData) -> None:
    """Write what is trained into a folder, or check that it is the same."""
    about = {
        "run": [run.label, run.seed],
        "features": experiment.features.model_dump(mode="json"),
        "model": experiment.model.model_dump(mode="json"),
        "training": experiment.training.model_dump(mode="json", exclude={"checkpoint_s", "compile"}),
        "windows": {part: fingerprint({"starts": starts.tolist()}) for part, starts in data.starts.items()},
    }
    file = folder / "run.json"
    if file.is_file():
        known = json.loads(file.read_text())
        wrong = [key for key, value in about.items() if known.get(key) != value]
        if wrong:
            raise InputError(f"{folder}: holds a run with other {', '.join(wrong)}; give another --out, or remove it")
    write_bytes_atomically(file, json.dumps(about, indent=1).encode())


def _save(folder: Path, model: nn.Module, optimizer: torch.optim.Optimizer, history: list[dict[str, float]]) -> None:
    state = {"model": model.state_dict(), "optimizer": optimizer.state_dict(), "history": history}
    write_bytes_atomically(folder / CHECKPOINT, torch_bytes(state))


def _resume(
    folder: Path, model: nn.Module, optimizer: torch.optim.Optimizer, device: torch.device
) -> list[dict[str, float]]:
    """Load the checkpoint of a folder, if there is one, and return the epochs that it has had."""
    file = folder / CHECKPOINT
    if not file.is_file():
        return []
    state = torch.load(file, map_location=device, weights_only=True)
    model.load_state_dict(state["model"])
    optimizer.load_state_dict(state["optimizer"])
    return state["history"]


def _line(row: dict[str, float], epochs: int) -> str:
    """Return one epoch for people."""
    return (
        f"epoch {row['epoch']:.0f}/{epochs}: loss {row['loss']:.3f}, validation {row['val_loss']:.3f}, gain "
        f"{row['gain']:.4f}, top-1 {row['top1']:.3f}, {row['seconds']:.1f} s, {row['windows_per_s']:,.0f} windows/s"
    )
