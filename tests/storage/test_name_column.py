"""A column of names by index is the dictionary that Arrow makes of its texts."""

import numpy as np
import pyarrow as pa
import pytest

from mmw.storage.name_column import name_column


@pytest.mark.parametrize("texts", [["b", "a", "b", "c"], ["b", None, "a", None], [], [None, None]])
def test_names_are_those_of_arrow(texts: list[str | None]) -> None:
    expected, found = pa.array(texts, pa.string()).dictionary_encode(), name_column(texts)
    assert found.to_arrow().equals(expected) and found.to_arrow().type == expected.type
    assert pa.array(found).equals(expected) and pa.array(found, pa.string()).to_pylist() == texts
    assert found.to_list() == texts and found.to_array().tolist() == texts
    assert found.has_null == (None in texts) and len(found) == len(texts)


def test_chosen_rows_keep_the_dictionary() -> None:
    texts = ["b", None, "a"]
    chosen, index = name_column(texts)[np.array([2, 2, 1])], pa.array([2, 2, 1])
    assert chosen.to_arrow().equals(pa.array(texts).dictionary_encode().take(index))
    assert chosen.to_list() == ["a", "a", None] and chosen[:2].to_list() == ["a", "a"] and not chosen[:2].has_null
