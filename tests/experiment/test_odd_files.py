"""Odd files of every kind are read right, refused or told. (About 5 s.)"""

from __future__ import annotations

from collections import Counter

import pytest

from tests.worlds.odd_files import all_of, bad

pytest.importorskip("nptdms")


@pytest.mark.filterwarnings("ignore")
def test_no_odd_file_gives_a_wrong_number_without_a_word():
    found = list(all_of())
    assert [f"{how}: {odd.kind}: {odd.name}: {said}" for odd, how, said in found if bad(odd, how)] == []
    assert len(found) >= 300 and len({odd.kind for odd, *_ in found}) >= 16
    # what is whole must be read, not refused, in every format
    good = Counter(how for odd, how, _ in found if odd.name == "good")
    assert set(good) == {"right"} and good.total() >= 17
    # a file, what is wrong, and what to do
    assert [odd for odd, how, said in found if how == "refused" and len(said.split()) < 3] == []
