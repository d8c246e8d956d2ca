"""The list of checks, what counts as agreement, and the page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mmw.validation import Check, Measurement, Reference, Source, all_checks, run_checks
from mmw.validation.page import write_page

SOURCE = Source("A body, A document", "table 1", "https://example.org", "document")
CHECK = Check(
    name="made_up.row", title="A row", computed="nothing", unit="dB", reference=Reference.plus_minus(1.0, 1.0),
    tolerance="none", sources=(SOURCE,), measure=lambda device: Measurement(1.5),
)  # fmt: skip


@pytest.mark.parametrize(
    ("value", "known_red", "is_green", "problem"),
    [
        (1.5, "", True, ""),
        (2.0, "", True, ""),
        (2.1, "", False, "red: it should agree"),
        (np.nan, "", False, "red: it should agree"),
        (2.1, "because", False, ""),
        (1.5, "because", True, "green, but listed as known to disagree: remove known_red"),
    ],
)
def test_a_row_is_green_within_its_range_and_a_surprise_is_a_problem(
    value: float, known_red: str, is_green: bool, problem: str
) -> None:
    (result,) = run_checks([replace(CHECK, measure=lambda device: Measurement(value), known_red=known_red)], "cpu")
    assert result.is_green == is_green
    assert result.problem == problem
    assert result.record["is_green"] == is_green
    assert (result.record["reference"], result.record["low"], result.record["high"]) == (1.0, 0.0, 2.0)


@pytest.mark.parametrize("wrong", [{"sources": ()}, {"name": "row"}])
def test_a_row_that_says_nothing_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match="check"):
        replace(CHECK, **wrong)


def test_a_reference_lies_in_its_range() -> None:
    with pytest.raises(ValueError, match="reference 3 is not in 0 to 2"):
        Reference(3.0, 0.0, 2.0)
    assert Reference.within_share(10.0, 0.25) == Reference(10.0, 7.5, 12.5)
    assert Reference.within_factor(10.0, 2.0) == Reference(10.0, 5.0, 20.0)
    assert Reference.plus_minus(10.0, 2.0).contains(12.0) and not Reference.plus_minus(10.0, 2.0).contains(12.1)


def test_a_source_says_how_it_was_checked() -> None:
    with pytest.raises(ValueError, match="choose one of document, abstract, other code, citation"):
        replace(SOURCE, seen="by memory")


def test_names_are_unique_and_every_range_can_fail() -> None:
    checks = all_checks()
    assert len({check.name for check in checks}) == len(checks)
    for check in checks:
        assert np.isfinite([check.reference.low, check.reference.high]).any(), check.name


def test_the_page_has_every_row_with_its_reason_and_figure(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")

    def draw(axes: object) -> None:
        axes.plot([0, 1], [0, 1])

    checks = [
        replace(CHECK, measure=lambda device: Measurement(1.5, "two samples", draw)),
        replace(CHECK, name="made_up.other", title="Another", known_red="a reason", measure=lambda _: Measurement(9.0)),
    ]
    write_page(run_checks(checks, "cpu"), tmp_path / "validation.md")
    page = (tmp_path / "validation.md").read_text()
    assert "1 of 2 rows are green" in page
    assert "two samples" in page
    assert "- Red: a reason" in page
    assert "![A row](validation/made_up.row.svg)" in page
    assert (tmp_path / "validation" / "made_up.row.svg").read_text().count("<svg") == 1


def test_the_page_of_the_documents_lists_all_rows() -> None:
    """The values are those of another machine; rows, ranges and colors are these."""
    page = (Path(__file__).parents[2] / "docs/reference/validation.md").read_text()
    sections = {part.partition("\n")[0]: part for part in page.split("### ")[1:]}
    checks = all_checks()
    assert list(sections) == [check.title for check in checks], "mmw validate --full --page"
    for check in checks:
        assert f"- `{check.name}`: {check.computed}" in sections[check.title]
        assert (f"- Red: {check.known_red}" in sections[check.title]) == bool(check.known_red), check.name
