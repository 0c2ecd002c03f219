"""The notebooks of docs/ run cell after cell, as a reader would; they hold no outputs."""

from __future__ import annotations

import ast
import json

import pytest
from shared import ROOT

BOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("book", BOOKS, ids=lambda b: b.stem)
def test_every_cell_runs_after_the_one_before(book, monkeypatch):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    monkeypatch.chdir(ROOT)
    cells = [c for c in json.loads(book.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]
    names: dict = {"__name__": "__main__"}
    shown = []
    for k, cell in enumerate(cells):
        assert cell["outputs"] == [] and cell["execution_count"] is None
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"{book.name}:{k}", "exec"), names)
        if last is not None:
            shown.append(eval(compile(ast.Expression(last.value), f"{book.name}:{k}", "eval"), names))
    if book.stem == "velocity_fields":
        sigma, measured = shown[2]
        assert 0.0 < sigma < 0.05 * 500.0 and measured > 0.7  # px/s
    if book.stem == "tracking":
        assert (names["path"].flag == "").mean() > 0.95
    if book.stem == "question_a_model":
        assert shown[-1][0] == ["dry"] or shown[-1][0] == ("dry",), shown
        assert "dry friction in the bearing" in shown[-2]
