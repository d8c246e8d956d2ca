"""The Python of docs/guides/torch.md runs as printed."""

import re
from pathlib import Path

import pytest

from tests.fixtures.window_data import window_data

pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'multimodal-wireless[torch]'")
pytestmark = pytest.mark.filterwarnings(
    "ignore:This DataLoader will create",
    "ignore:.*fork:DeprecationWarning",  # one core; Python 3.12 and threads
)


def test_the_examples_run(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    text = (Path(__file__).parents[2] / "docs" / "guides" / "torch.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 4
    names: dict = {}
    for block in blocks:
        exec(compile(block.replace("DATASET", str(window_data())), "torch.md", "exec"), names)
    told = capsys.readouterr().out
    assert "'train':" in told and "cav_1" in told and "torch.float32" in told
    assert names["images"].shape[1:3] == (4, 3) and names["points"].shape[1:][0] == 4
    assert names["target"].shape[1:] == (10,) and len(names["test"]) > 0 and len(names["sunny"]) > 0
    assert any((tmp_path / "beams-cache").iterdir())
