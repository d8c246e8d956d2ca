"""The Python of docs/guides/query.md runs as printed."""

import re
from pathlib import Path

from tests.fixtures.small_dataset import small_dataset


def test_the_examples_run(capsys) -> None:
    text = (Path(__file__).parents[2] / "docs" / "guides" / "query.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 6
    names: dict = {}
    for block in blocks:
        exec(compile(block.replace("DATASET", str(small_dataset())), "query.md", "exec"), names)
    told = capsys.readouterr().out
    assert "gain_db" in told and "cav_1 cav" in told and names["data"].root == small_dataset().resolve()
