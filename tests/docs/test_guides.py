"""The Python of guides that read any dataset runs as printed."""

import re
from pathlib import Path
from typing import Any

import pytest

from tests.fixtures.window_data import window_data

GUIDES = Path(__file__).parents[2] / "docs" / "guides"


def run_guide(page: str, dataset: Path, count: int) -> dict[str, Any]:
    """Run the Python blocks of a page, `count` of them, on a dataset, and return their names."""
    blocks = re.findall(r"```python\n(.*?)```", (GUIDES / page).read_text(), re.DOTALL)
    assert len(blocks) == count
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block.replace("DATASET", str(dataset)), page, "exec"), names)
    return names


@pytest.mark.filterwarnings(
    "ignore:This DataLoader will create",
    "ignore:.*fork:DeprecationWarning",  # one core; Python 3.12 and threads
)
def test_torch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'multimodal-wireless[torch]'")
    monkeypatch.chdir(tmp_path)
    names = run_guide("torch.md", window_data(), 4)
    told = capsys.readouterr().out
    assert "'train':" in told and "cav_1" in told and "torch.float32" in told
    assert names["images"].shape[1:3] == (4, 3) and names["points"].shape[1:][0] == 4
    assert names["target"].shape[1:] == (10,) and len(names["test"]) > 0 and len(names["sunny"]) > 0
    assert any((tmp_path / "beams-cache").iterdir())
