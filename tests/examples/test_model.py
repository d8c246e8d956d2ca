"""The network, the baselines and the scores of beam prediction: shapes, equalities, laws."""

import dataclasses
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'multimodal-wireless[torch]'")
pytest.importorskip("transformers", reason="transformers is not installed: pip install 'multimodal-wireless[torch]'")

from torch import Tensor  # noqa: E402
from transformers import GPT2Config, GPT2Model  # noqa: E402

from examples.beam_prediction.baselines import extrapolate, hold_last, recall  # noqa: E402
from examples.beam_prediction.config import ModelConfig  # noqa: E402
from examples.beam_prediction.data import Batch, BeamData, beam_angles  # noqa: E402
from examples.beam_prediction.encoders import SensorReader, crop  # noqa: E402
from examples.beam_prediction.metrics import drive_interval, score  # noqa: E402
from examples.beam_prediction.model import BeamPredictor, Gpt2, beam_waves, hills, last_beam  # noqa: E402
from examples.beam_prediction.sensors import SensorData  # noqa: E402
from examples.beam_prediction.training import beam_loss, gain_loss, make_optimizer, schedule  # noqa: E402
from mmw.channel import ula  # noqa: E402
from mmw.channel.codebook import beam_gains, best_beams, dft_codebook, normalized_gain  # noqa: E402

Q, PAST, FUTURE = 64, 12, 4
SOURCES = ["rsu/lidar", "rsu/front"]
CONFIG = ModelConfig(
    random_init=True, layers=2, width=32, heads=4, dropout=0.0, channels=(8, 16), crop_beams=16, gru_width=24
)


@pytest.fixture
def data() -> BeamData:
    """Return 100 synthetic frames of one vehicle with two sensors at 10 Hz."""
    generator = torch.Generator().manual_seed(3)
    count = 100
    beam = torch.randint(0, Q, (count,), generator=generator)
    beam[40:45] = -1
    held = torch.arange(count) // 10
    sizes = {"rsu/lidar": (3, 16, 2 * Q), "rsu/front": (3, 24, Q), "cav/lidar": (3, 16, Q)}
    sensors = {}
    for source, size in sizes.items():
        samples = torch.randint(0, 256, (10, *size), generator=generator, dtype=torch.uint8)
        modality, is_rsu = "camera" if source.endswith("front") else "lidar", source.startswith("rsu/")
        usual, agent = samples.median(dim=0).values[None], torch.zeros(10, dtype=torch.int64)
        sensors[source] = SensorData(is_rsu, modality, samples, held, usual, agent)
    return BeamData(
        track=[("s", "sunny", "cav_1")] * count, peer=["rsu_1"] * count, frame=np.arange(count), beams=Q, past=PAST,
        future=FUTURE, tx_beam=beam, gains=torch.rand(count, Q, generator=generator), is_los=beam >= 0, every=10,
        age=torch.arange(count) % 10, sensors=sensors,
        starts={"train": torch.arange(0, 60), "val": torch.arange(60, 84)},
    )  # fmt: skip


def test_a_batch_holds_what_was_there(data: BeamData) -> None:
    starts = torch.tensor([38, 3, 0, 9])
    batch = data.batch(starts, SOURCES)
    assert torch.equal(batch.beams[1], data.tx_beam[3:15]) and torch.equal(batch.age[1], torch.arange(3, 15) % 10)
    assert (batch.beams[0, 2:7] == Q).all() and (batch.beams[0, :2] < Q).all()
    for source in SOURCES:
        for window, start in enumerate(starts.tolist()):
            for step in range(PAST):
                held = batch.samples[source][window, batch.slot[window, step]]
                assert torch.equal(held, data.sensors[source].samples[(start + step) // 10]), (source, start, step)
    assert torch.equal(data.targets(starts)[0], data.tx_beam[50:54])
    assert torch.equal(data.target_gains(starts)[1], data.gains[15:19])


def test_samples_are_compared_with_what_is_usual_or_was_before(data: BeamData) -> None:
    batch = data.batch(torch.tensor([38, 3]), [*SOURCES, "cav/lidar"])
    for source in SOURCES:
        usual = batch.references[source]
        assert usual.shape[1] == 1 and torch.equal(usual[1, 0], data.sensors[source].samples.median(dim=0).values)
    own = batch.samples["cav/lidar"]
    assert torch.equal(batch.references["cav/lidar"][:, 1:], own[:, :-1])
    assert torch.equal(batch.references["cav/lidar"][:, 0], own[:, 0])


def test_a_mirrored_window_has_left_and_right_exchanged(data: BeamData) -> None:
    starts, mirrored = torch.tensor([38, 3, 50]), torch.tensor([[True, False], [False, False], [False, True]])
    plain, turned = data.batch(starts, SOURCES), data.batch(starts, SOURCES, mirrored)
    for before, after in ((plain.beams, turned.beams), (data.targets(starts), data.targets(starts, mirrored))):
        is_there = (before[0] >= 0) & (before[0] < Q)
        assert torch.equal(after[0], torch.where(is_there, (Q - before[0]) % Q, before[0]))
        assert torch.equal(after[1:], before[1:])
    gains, turned_gains = data.target_gains(starts), data.target_gains(starts, mirrored)
    for beam in (0, 1, 31, 32, 63):
        assert torch.equal(turned_gains[0, :, (Q - beam) % Q], gains[0, :, beam])
    assert torch.equal(turned_gains[1:], gains[1:])
    # What is seen around beam q is seen around beam -q, turned round; what is ahead is then behind.
    for source in SOURCES:
        columns = plain.samples[source].shape[-1]
        for before, after in ((plain.samples, turned.samples), (plain.references, turned.references)):
            seen = crop(before[source], torch.full((3,), 5 * columns // Q), 8)
            again = crop(after[source], torch.full((3,), (Q - 5) * columns // Q), 8)
            assert torch.equal(again[0], seen[0].flip(-1)) and not torch.equal(again[1], seen[1])
            half = before[source].shape[-2] // 2
            assert torch.equal(after[source][2, ..., :half, :], before[source][2, ..., half:, :])
            assert torch.equal(after[source][2, ..., half:, :], before[source][2, ..., :half, :])


def test_a_mirrored_vehicle_drives_forwards(data: BeamData) -> None:
    starts, every = torch.full((4,), 20), torch.tensor([[False, False], [True, False], [False, True], [True, True]])
    samples = data.batch(starts, ["cav/lidar"], every).samples["cav/lidar"]
    assert torch.equal(samples[0], samples[3]) and torch.equal(samples[1], samples[2])
    assert torch.equal(samples[1], samples[0].flip(-1))


@pytest.mark.parametrize("backbone", ["gpt2", "gru"])
@pytest.mark.parametrize("sources", [[], ["rsu/lidar"], ["rsu/front"], [*SOURCES, "cav/lidar"]], ids=len)
def test_one_code_path_for_all_inputs(data: BeamData, sources: list[str], backbone: str) -> None:
    torch.manual_seed(0)
    model = BeamPredictor(CONFIG, data, sources, backbone).eval()
    starts = torch.tensor([3, 21, 50])
    batch = data.batch(starts, sources)
    logits = model(batch)
    assert logits.shape == (3, FUTURE, Q) and logits.isfinite().all()
    beam_loss(logits, data.targets(starts), data.target_gains(starts)).backward()
    for source in sources:
        reader = model.readers[source.replace("/", "_")]
        assert reader.convolutions[0].weight.grad.abs().sum() > 0
        batch.samples[source].fill_(0)
        assert not torch.allclose(model(batch), logits)


def test_a_window_is_predicted_alike_in_any_batch(data: BeamData) -> None:
    model = BeamPredictor(CONFIG, data, SOURCES).eval()
    together = model(data.batch(torch.tensor([3, 21, 50]), SOURCES))
    alone = model(data.batch(torch.tensor([21]), SOURCES))
    torch.testing.assert_close(together[1:2], alone, rtol=1e-4, atol=1e-5)


def test_no_frame_sees_a_sample_of_later_frames(data: BeamData) -> None:
    """Tokens of the past hold samples up to their own time; the state at a token does not depend on later tokens."""
    torch.manual_seed(0)
    model = BeamPredictor(CONFIG, data, SOURCES).eval()
    batch = data.batch(torch.tensor([5]), SOURCES)  # frames 5 to 16: samples 0 and 1
    last = last_beam(batch.beams, Q)[0]
    before = model._read(batch, last)
    batch.samples["rsu/lidar"][:, 1:].fill_(0)
    after = model._read(batch, last)
    assert torch.equal(before[:, :5], after[:, :5]) and not torch.allclose(before[:, 5:], after[:, 5:])


def test_some_windows_are_trained_without_a_sensor(data: BeamData) -> None:
    torch.manual_seed(0)
    model = BeamPredictor(CONFIG.model_copy(update={"sensor_dropout": 0.5}), data, SOURCES)
    assert (model._modality_weights(1000, torch.device("cpu"))["lidar"].mean() - 0.5).abs() < 0.1
    assert (model.eval()._modality_weights(1000, torch.device("cpu"))["camera"] == 1).all()


def test_what_is_learned_in_one_direction_holds_in_all(data: BeamData) -> None:
    """Without names of beams, a scene that is turned by 5 beams gives logits that are turned by 5 beams."""
    torch.manual_seed(0)
    model = BeamPredictor(CONFIG, data, SOURCES).eval()
    for module in (model.absolute, model.beam, model.wave):
        for parameter in module.parameters():
            torch.nn.init.zeros_(parameter)
    batch = data.batch(torch.tensor([3, 21, 50]), SOURCES)
    logits = model(batch)
    beams, at_samples = (torch.where(x < Q, (x + 5) % Q, Q) for x in (batch.beams, batch.sample_beams))
    samples, references = (
        {source: one.roll(5 * one.shape[-1] // Q, dims=-1) for source, one in some.items()}
        for some in (batch.samples, batch.references)
    )
    turned = model(Batch(beams, batch.age, batch.slot, samples, references, at_samples))
    torch.testing.assert_close(turned, logits.roll(5, dims=2))


def test_sensors_of_a_vehicle_are_seen_whole(data: BeamData) -> None:
    """Their columns are beams of the vehicle, so they do not depend on the transmitter's beam."""
    model = BeamPredictor(CONFIG, data, ["cav/lidar"]).eval()
    assert model.readers["cav_lidar"].columns == Q
    batch = data.batch(torch.tensor([3, 21]), ["cav/lidar"])
    one, other = (model._read(batch, torch.tensor(last)) for last in ([0, 0], [9, 40]))
    assert torch.equal(one, other)


def test_a_crop_goes_round_the_circle_of_beams() -> None:
    samples = torch.arange(10).expand(2, 3, 1, 4, 10)
    found = crop(samples, torch.tensor([1, 5]), 4)
    assert found.shape == (2, 3, 1, 4, 4)
    assert found[0, 2, 0, 3].tolist() == [9, 0, 1, 2] and found[1, 0, 0, 0].tolist() == [3, 4, 5, 6]
    reader = SensorReader((1, 16, 10), (8, 8), 12, 40)
    assert reader.columns == 10
    samples = torch.zeros(2, 3, 1, 16, 10).byte()
    assert reader(samples, samples[:, :1], torch.tensor([0, 1]), torch.zeros(2, 3, 5)).shape == (2, 3, 12)


def test_a_hint_shows_the_beam_of_a_sample() -> None:
    found = hills(torch.tensor([[9, 12, Q], [63, 1, 30]]), torch.tensor([10, 0]), Q, 32, 16.0)  # half a beam a cell
    assert found.shape == (2, 3, 32)
    peak = found.argmax(dim=2)
    assert peak[0, 0] in (13, 14) and peak[0, 1] in (19, 20) and peak[1, 0] in (13, 14) and peak[1, 1] in (17, 18)
    assert not found[0, 2].any() and found[1, 2].max() < 1e-9  # none is known; outside the crop


def test_angles_between_beams_are_found() -> None:
    """Of one path in a known direction, the two strongest beams give its position between them."""
    angle = torch.tensor([0.0, 7.3, 20.5, 41.75, 63.6])
    n = np.arange(64)
    h = np.exp(2j * np.pi * np.outer(angle.numpy(), n) / Q).conj()[:, None, :]  # one receive antenna
    gains = np.abs((h @ dft_codebook(ula(64), Q))[:, 0]) ** 2
    best, gains = gains.argmax(axis=1), gains / gains.max(axis=1, keepdims=True)
    found = beam_angles(torch.tensor([*best, -1]), torch.from_numpy(np.vstack([gains, gains[:1]])))
    away = (found[:-1] - angle + Q / 2) % Q - Q / 2
    assert away.abs().max() < 1e-3 and found[-1].isnan()


def test_known_angles_make_a_straight_line_better() -> None:
    """A beam that will move on in two frames has not moved yet: only its angle has."""
    angle = 10.01 + 0.02 * (torch.arange(50) - 20.0)  # 10.5 after the 44th frame
    beams = torch.round(angle).long()[None]
    assert (beams[0, :40] == 10).all() and beams[0, 49] == 11
    assert (extrapolate(beams[:, :40], 10, Q) == 10).all()
    assert torch.equal(extrapolate(beams[:, :40], 10, Q, angle[None, :40]), beams[:, 40:])


def test_waves_go_round_the_circle_of_beams() -> None:
    waves = beam_waves(Q)
    distance = (waves[:Q] - waves[:Q].roll(-1, dims=0)).norm(dim=1)
    torch.testing.assert_close(distance, distance[:1].expand(Q))  # Q - 1 is as near to 0 as 1 is
    assert not waves[Q].any()


def test_the_last_known_beam() -> None:
    past = torch.tensor([[5, 7, Q, Q], [Q, Q, Q, Q], [1, 2, 3, 0]])
    beam, is_known = last_beam(past, Q)
    assert beam.tolist() == [7, 0, 0] and is_known.tolist() == [True, False, True]
    assert hold_last(past, 2, Q).tolist() == [[7, 7], [0, 0], [0, 0]]


def at_speed(first: float, speed: float, frames: int) -> Tensor:
    """Return the beams of a direction that moves by `speed` beams a frame."""
    return torch.round(first + speed * torch.arange(frames)).long() % Q


@pytest.mark.parametrize(("first", "speed"), [(10.0, 0.25), (60.0, 0.5), (3.0, -0.4), (20.0, 0.0)])
def test_a_steady_turn_is_extrapolated(first: float, speed: float) -> None:
    beams = at_speed(first, speed, 50)
    found = extrapolate(beams[None, :40], 10, Q)[0]
    assert ((found - beams[40:] + 32) % Q - 32).abs().max() <= 1  # by the rounding of the past
    if speed:
        held = hold_last(beams[None, :40], 10, Q)[0]
        assert ((held - beams[40:] + 32) % Q - 32).abs().max() >= 2


def test_extrapolation_begins_anew_after_a_jump_or_a_gap() -> None:
    beams = torch.cat([at_speed(40.0, 0.5, 30), at_speed(5.0, 0.0, 10)])[None]
    assert (extrapolate(beams, 10, Q) == 5).all()
    beams[0, 38] = Q
    assert (extrapolate(beams, 10, Q) == 5).all()
    beams[0, 39] = Q
    assert (extrapolate(beams, 10, Q) == 5).all()  # nothing is known now: the last beam


def test_what_was_trained_is_remembered(data: BeamData) -> None:
    known = dataclasses.replace(data, starts={"train": torch.arange(0, 84), "val": data.starts["val"]})
    held = hold_last(known.batch(known.starts["val"], ()).beams, FUTURE, Q)
    targets = known.targets(known.starts["val"])
    for sources in ((), SOURCES):
        assert torch.equal(recall(known, sources), torch.where(targets < 0, held, targets))


@pytest.mark.parametrize("sources", [(), SOURCES])
def test_the_nearest_window_is_that_of_brute_force(data: BeamData, sources: list[str]) -> None:
    train, val = (data.starts[part].numpy() for part in ("train", "val"))
    beam = data.tx_beam.numpy()
    points = np.where(beam < 0, 0.0, np.exp(2j * np.pi * beam / Q))
    past = np.stack([points[start : start + PAST] for start in range(85)])
    apart = np.linalg.norm(past[val][:, None] - past[train], axis=2)
    total = apart / apart[::50][:, ::50].mean()
    for source in sources:
        samples = data.sensors[source].samples.numpy().reshape(10, -1).astype(float)
        between = np.linalg.norm(samples[:, None] - samples, axis=2)
        total += (between / between.mean())[(val + PAST - 1) // 10][:, (train + PAST - 1) // 10]
    targets = data.targets(data.starts["train"])
    held = hold_last(data.batch(data.starts["train"], ()).beams, FUTURE, Q)
    assert torch.equal(recall(data, sources), torch.where(targets < 0, held, targets)[total.argmin(axis=1)])


def test_an_interval_over_drives_counts_drives_not_windows() -> None:
    rng = np.random.default_rng(2)
    assert drive_interval(np.full((6, 2), 0.25), np.array([0, 0, 0, 1, 2, 2])) == (0.25, 0.25)
    value = rng.normal(size=400)
    once = drive_interval(value[:, None], np.arange(400))
    width = 2 * 1.96 * value.std() / 20  # of a mean of 400 independent drives
    assert once[1] - once[0] == pytest.approx(width, rel=0.06) and np.mean(once) == pytest.approx(
        value.mean(), abs=0.01
    )
    often = drive_interval(np.repeat(value, 50)[:, None], np.repeat(np.arange(400), 50))
    assert often == pytest.approx(once)
    gap = np.where(np.arange(400)[:, None] < 200, np.nan, value[:, None])
    assert drive_interval(gap, np.arange(400))[0] < np.nanmean(gap) < drive_interval(gap, np.arange(400))[1]


def test_scores_are_those_of_the_channel() -> None:
    rng = np.random.default_rng(1)
    h = rng.standard_normal((30, 16, 64)) + 1j * rng.standard_normal((30, 16, 64))
    gains = beam_gains(h, dft_codebook(ula(64), Q), dft_codebook(ula(16), Q))
    best = best_beams(gains)
    every = normalized_gain(gains, np.tile(np.arange(Q), (30, 1)), best).reshape(10, 3, Q)
    target = best.tx_beam.reshape(10, 3).copy()
    oracle = score(target[..., None], target, every)
    assert np.allclose(oracle.gain, 1.0) and oracle.hits[1].all()
    predicted = rng.integers(0, Q, (10, 3, 5))
    found = score(predicted, target, every)
    wanted = normalized_gain(gains, predicted[..., 0].reshape(30), best).reshape(10, 3)
    np.testing.assert_allclose(found.gain, wanted, rtol=1e-6)
    for k in (1, 3, 5):
        assert np.array_equal(found.hits[k], (predicted[..., :k] == target[..., None]).any(axis=2))
    target[0, 0] = -1
    assert np.isnan(score(predicted, target, every).gain[0, 0]) and np.isnan(
        score(predicted, target, every).hits[5][0, 0]
    )
    assert len(found.rows()["gain"]) == 3 and found.rows()["top5"] >= found.rows()["top1"]


def test_frames_without_path_have_no_loss() -> None:
    torch.manual_seed(0)
    logits = torch.randn(2, 3, Q, requires_grad=True)
    target = torch.tensor([[1, -1, 2], [-1, -1, -1]])
    gains = torch.rand(2, 3, Q).masked_fill((target < 0)[..., None], torch.nan)
    wanted = torch.nn.functional.cross_entropy(logits[0, [0, 2]], torch.tensor([1, 2]))
    torch.testing.assert_close(beam_loss(logits, target, gains), wanted)
    expected = (logits[0, [0, 2]].softmax(1) * gains[0, [0, 2]]).sum(1)
    torch.testing.assert_close(gain_loss(logits, target, gains), -expected.log().mean())
    for loss in (beam_loss, gain_loss):
        logits.grad = None
        loss(logits, torch.full((2, 3), -1), gains).backward()
        assert logits.grad is not None and not logits.grad.any()


def test_local_weights_are_used_and_may_be_frozen(tmp_path: Path) -> None:
    torch.manual_seed(5)
    saved = GPT2Model(GPT2Config(n_embd=32, n_layer=3, n_head=4, n_positions=32, vocab_size=11))
    saved.save_pretrained(tmp_path)
    config = CONFIG.model_copy(update={"random_init": False, "weights": str(tmp_path), "freeze": True})
    loaded = Gpt2(config, 16)
    assert loaded.width == 32 and len(loaded.model.h) == 2
    assert torch.equal(loaded.model.h[1].attn.c_attn.weight, saved.h[1].attn.c_attn.weight)
    trained = {name for name, parameter in loaded.model.named_parameters() if parameter.requires_grad}
    assert {"wpe.weight", "ln_f.weight", "h.0.ln_1.weight"} <= trained
    assert not any("attn.c_" in name or "mlp" in name or "wte" in name for name in trained)
    assert loaded(torch.randn(2, 16, 32)).shape == (2, 16, 32)
    with pytest.raises(ValueError, match="3 layers for 32 tokens; 4 and 50 are needed"):
        Gpt2(config.model_copy(update={"layers": 4}), 50)
    with pytest.raises(ValueError, match="no GPT-2 is there"):
        Gpt2(config.model_copy(update={"weights": str(tmp_path / "other")}), 16)


def test_the_step_size_rises_and_falls() -> None:
    values = [schedule(step, 100, 0.1) for step in range(100)]
    assert values[9] == max(values) == 1.0 and values[0] == pytest.approx(0.1) and values[-1] < 0.01
    assert all(b <= a for a, b in pairwise(values[9:]))


def test_weight_decay_is_for_matrices(data: BeamData) -> None:
    from examples.beam_prediction.config import TrainingConfig

    model = BeamPredictor(CONFIG, data, SOURCES)
    decayed, plain = make_optimizer(model, TrainingConfig(), torch.device("cpu")).param_groups
    assert all(p.ndim >= 2 for p in decayed["params"]) and all(p.ndim < 2 for p in plain["params"])
    assert plain["weight_decay"] == 0.0 < decayed["weight_decay"]
