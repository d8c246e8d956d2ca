"""The Python of guides that read any dataset runs as printed."""

from pathlib import Path

import pytest

from tests.fixtures.doc_pages import ROOT, run_python
from tests.fixtures.window_data import window_data


@pytest.mark.filterwarnings(
    "ignore:This DataLoader will create",
    "ignore:.*fork:DeprecationWarning",  # one core; Python 3.12 and threads
)
def test_torch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'multimodal-wireless[torch]'")
    monkeypatch.chdir(tmp_path)
    names = run_python(ROOT / "docs" / "guides" / "torch.md", "DATASET", window_data())
    told = capsys.readouterr().out
    assert "'train':" in told and "cav_1" in told and "torch.float32" in told
    assert names["images"].shape[1:3] == (4, 3) and names["points"].shape[1:][0] == 4
    assert names["target"].shape[1:] == (10,) and len(names["test"]) > 0 and len(names["sunny"]) > 0
    assert any((tmp_path / "beams-cache").iterdir())
