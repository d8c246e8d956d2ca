"""Windows as tensors: datasets, batches and workers; `tests/dataset/windows` tests their content."""

import subprocess
import sys
from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'multimodal-wireless[torch]'")

from torch.utils.data import DataLoader  # noqa: E402

from mmw.dataset.windows import Feature, Windows, WindowSpec, open_windows, split_windows  # noqa: E402
from mmw.torch import WindowDataset, WindowStream, collate, to_tensors  # noqa: E402
from tests.fixtures.window_data import window_data  # noqa: E402

pytestmark = pytest.mark.filterwarnings(
    "ignore:This DataLoader will create",
    "ignore:.*fork:DeprecationWarning",  # one core; Python 3.12 and threads
)
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def windows() -> Windows:
    features = [Feature("links", carrier_hz=28e9), "lidar", "boxes", Feature("rgb", every=4), "poses"]
    return open_windows(window_data(), WindowSpec(features, past=4, stride=6), scenarios=["circle"])


def names(batches) -> list[tuple[int, int]]:
    """Return track and `now` of every window, in order."""
    return [pair for b in batches for pair in zip(b["track"].tolist(), b["now"].tolist(), strict=True)]


def all_names(windows: Windows) -> list[tuple[int, int]]:
    return sorted(zip(windows.track.tolist(), windows.now.tolist(), strict=True))


def test_tensors_have_the_types_and_values_of_the_arrays(windows: Windows) -> None:
    data = WindowDataset(windows)
    assert len(data) == len(windows)
    sample, arrays = data[3], windows[3]
    assert {key: value.dtype for key, value in sample.items() if not isinstance(value, list)} == {
        "now": torch.int64, "track": torch.int64, "links": torch.float32, "links_frame": torch.int64,
        "lidar_frame": torch.int64, "boxes_frame": torch.int64, "rgb": torch.uint8, "rgb_frame": torch.int64,
        "poses": torch.float32, "poses_frame": torch.int64,
    }  # fmt: skip
    assert sample["boxes"][0].dtype == torch.float32 and sample["boxes_object_id"][0].dtype == torch.int64
    assert all(torch.equal(one, torch.from_numpy(same)) for one, same in zip(sample["lidar"], arrays["lidar"]))  # noqa: B905
    assert data[-1]["now"] == windows.now[-1]
    with pytest.raises(IndexError, match=f"window {len(windows)}; there are {len(windows)}"):
        data[len(windows)]
    sample["lidar"][0].zero_()
    assert data[3]["lidar"][0].equal(torch.from_numpy(arrays["lidar"][0]))  # the cache keeps its own


def test_a_loader_of_the_map_style_dataset(windows: Windows) -> None:
    loader = DataLoader(WindowDataset(windows), batch_size=5, shuffle=True, collate_fn=collate, num_workers=2)
    batches = list(loader)
    assert sorted(names(batches)) == all_names(windows)
    for batch in batches:
        count, points = batch["lidar_count"], batch["lidar"]
        assert points.shape[:2] == count.shape and points.shape[2] == count.max() and count.dtype == torch.int64
        behind = torch.arange(points.shape[2]) >= count[..., None]
        assert not points[behind].any() and (batch["boxes_object_id"] >= -1).all()
        assert batch["rgb"].shape[1:] == (1, 16, 24, 3) and batch["links"].shape[1:] == (4, 6)
    listed = collate([WindowDataset(windows)[n] for n in (0, 1)], "list")
    assert [len(window) for window in listed["lidar"]] == [4, 4] and listed["lidar"][0][0].shape[1] == 4
    with pytest.raises(ValueError, match="pad or list"):
        collate([WindowDataset(windows)[0]], "cut")


def test_a_transform_sees_tensors_and_its_result_counts(windows: Windows) -> None:
    data = WindowDataset(windows, transform=lambda sample: sample["links"][:, 0] * 2)
    want = windows[0]["links"][:, 0]
    assert torch.equal(data[0], torch.from_numpy(want) * 2)
    stream = WindowStream(windows, 4, shuffle=False, transform=lambda batch: batch["links"])
    assert torch.equal(next(iter(stream))[0], torch.from_numpy(windows[0]["links"]))


@pytest.mark.parametrize("workers", [0, 2])
def test_a_stream_gives_every_window_once_an_epoch(windows: Windows, workers: int) -> None:
    stream = WindowStream(windows, 4, seed=1, buffer=8)
    loader = DataLoader(stream, batch_size=None, num_workers=workers, persistent_workers=workers > 0)
    rounds = []
    for epoch in range(2):
        stream.set_epoch(epoch)
        rounds.append(names(loader))
    stream.set_epoch(0)
    assert sorted(rounds[0]) == sorted(rounds[1]) == all_names(windows)
    assert rounds[0] != rounds[1] and rounds[0] == names(loader)


def test_ranks_share_the_windows(windows: Windows) -> None:
    found = []
    for rank in range(3):
        stream = WindowStream(windows, 4, rank=rank, ranks=3)
        own = names(DataLoader(stream, batch_size=None, num_workers=1))
        assert len(own) == stream.window_count() and own
        found += own
    assert sorted(found) == all_names(windows)
    for wrong in ({"rank": 3, "ranks": 3}, {"buffer": 0}):
        with pytest.raises(ValueError, match="rank is 0 to ranks - 1"):
            WindowStream(windows, 4, **wrong)


def test_a_model_learns_from_parts_that_share_nothing() -> None:
    """From end to end: split, stream, and a linear model that finds x of the pose from itself."""
    windows = open_windows(window_data(), WindowSpec(["poses"], past=4, stride=3), scenarios=["circle"])
    parts = split_windows(windows, "track", {"train": 2, "test": 1}, seed=1, gap=4)
    model = torch.nn.Linear(13, 1)
    optimizer = torch.optim.Adam(model.parameters(), lr=0.05)
    stream = WindowStream(parts["train"], 8)
    for epoch in range(30):
        stream.set_epoch(epoch)
        for batch in stream:
            loss = torch.nn.functional.mse_loss(model(batch["poses"])[..., 0], batch["poses"][..., 0])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    test = collate([WindowDataset(parts["test"])[n] for n in range(len(parts["test"]))])["poses"]
    assert torch.nn.functional.mse_loss(model(test)[..., 0], test[..., 0]) < 0.1 * test[..., 0].var()


def test_to_tensors_shares_memory(windows: Windows) -> None:
    sample = windows[0]
    to_tensors(sample)["poses"].zero_()
    assert not sample["poses"].any()


def test_without_torch_one_error_names_the_extra() -> None:
    code = (
        "import sys\nsys.modules['torch'] = None\nimport mmw.dataset.windows\n"
        "try:\n    import mmw.torch\nexcept ImportError as error:\n    print(error)\n"
    )
    output = subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True).stdout
    assert "needs the package torch, which is not installed; pip install 'multimodal-wireless[torch]'" in output
