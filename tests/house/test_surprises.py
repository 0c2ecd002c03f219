"""docs/surprises.md is made from the marks of the tests, all of them."""

from __future__ import annotations

import sys

from shared import ROOT


def test_every_mark_is_a_row(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import surprises

    marks = sum(
        f.read_text(encoding="utf-8").count("@pytest.mark.surprise(\n") for f in (ROOT / "tests").rglob("test_*.py")
    )
    rows = [line for line in surprises.text().splitlines() if line.startswith("| ")][1:]
    assert len(rows) == marks > 9
    assert all(len([c for c in row.strip("| ").split(" | ") if c]) == 4 for row in rows)
    sys.modules.pop("surprises")
