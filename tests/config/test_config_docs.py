"""The page of all keys is made from the models, and names sources of keys that exist."""

import os
from pathlib import Path

from mmw.config.config_docs import SOURCES, configuration_page
from mmw.config.sensors import default_sensors

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "configuration.md"


def test_the_page_is_current() -> None:
    if os.environ.get("MMW_UPDATE_GOLDEN") == "1":
        PAGE.write_text(configuration_page(), encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8") == configuration_page(), (
        "MMW_UPDATE_GOLDEN=1 pytest tests/config/test_config_docs.py"
    )


def test_every_key_has_a_meaning_and_a_unit() -> None:
    rows = [line.split(" | ") for line in PAGE.read_text().splitlines() if line.startswith("| `")]
    assert len(rows) > 200
    for row in rows:
        meaning = row[2]
        assert meaning.rstrip().endswith((")", "]")), row


def test_sources_are_of_keys_that_exist() -> None:
    text = PAGE.read_text()
    for key in SOURCES:
        assert f"| `{key.rpartition('.')[2]}` |" in text, key
    assert text.count("| paper |") == sum(source == "paper" for source in SOURCES.values())


def test_the_default_suite_is_on_the_page() -> None:
    for sensor in default_sensors():
        assert f"## `sensors`: `{sensor.type}`" in PAGE.read_text()
