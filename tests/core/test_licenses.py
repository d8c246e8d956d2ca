"""Licenses of data have the names of SPDX, and a file that names them."""

import pytest

from mmw.config import Config, ConfigError, OutputConfig, load_config
from mmw.core.licenses import OWN, TITLES, license_file, license_name, license_of


@pytest.mark.parametrize("name", TITLES)
def test_known_licenses_in_any_case(name: str) -> None:
    assert license_name(f" {name.lower()} ") == license_name(name.upper()) == name
    text = license_file(name)
    assert license_of(text) == name and TITLES[name] in text and f"https://spdx.org/licenses/{name}.html" in text


def test_other_identifiers_and_texts() -> None:
    assert license_of(license_file(license_name("EUPL-1.2"))) == "EUPL-1.2"
    text = license_name("For members of the project alone; ask before you copy it.")
    assert license_of(license_file(text)) == OWN and text in license_file(text)
    assert license_of("no such line\n") == ""


@pytest.mark.parametrize(
    ("given", "message"),
    [("CC-BY-4", "did you mean CC-BY-4.0"), ("ccby-4.0", "did you mean CC-BY-4.0"), ("''", "is empty; an SPDX")],
)
def test_a_misspelled_license_is_one_line(given: str, message: str) -> None:
    with pytest.raises(ConfigError, match=rf"output\.license.*{message}") as caught:
        load_config("quickstart", [f"output.license={given}"])
    assert len(caught.value.problems) == 1


def test_a_license_does_not_make_another_dataset() -> None:
    one = load_config("quickstart")
    other = one.model_copy(update={"output": OutputConfig(license="CC0-1.0", notices=("ours",))})
    assert isinstance(one, Config) and one.output.license == "CC-BY-4.0"
    assert one.sha256() == other.sha256()
