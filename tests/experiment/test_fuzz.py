"""Damaged files of every kind: a clear error or sound frames; no crash, hang, lost memory."""

from __future__ import annotations

import sys

import pytest

from tests.worlds import fuzz_files

CASES = 25  # of each kind


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits time and memory of processes as Linux does")
@pytest.mark.parametrize("part", range(2))
def test_damaged_files_are_read_or_refused(tmp_path, part):
    names = sorted(fuzz_files.samples(tmp_path))[part::2]
    assert len(names) >= 11
    refused, findings = fuzz_files.fuzz(tmp_path, names, CASES)
    assert findings == []
    assert refused.keys() == {*names} and min(refused.values()) > 0  # the damage did reach what matters
