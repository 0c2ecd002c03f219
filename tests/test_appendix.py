"""The appendix of docs/: few words, tables that one command makes anew and leaves the words around them alone."""

from __future__ import annotations

import re
from types import SimpleNamespace

import pytest
from conftest import ROOT

from benchmarks import run

DOCS = ROOT / "docs"
APPENDIX = "benchmarks", "features", "real"


def prose(text: str) -> list[str]:
    """Words outside tables and code."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    return " ".join(line for line in text.splitlines() if not line.startswith("|")).split()


def test_the_appendix_has_at_most_6000_words_beside_its_tables():
    index = (DOCS / "README.md").read_text(encoding="utf-8").partition("## Appendix")[2]
    assert set(APPENDIX) == {*re.findall(r"\]\((\w+)\.md\)", index)} - {"keys", "api"}
    assert sum(len(prose((DOCS / f"{n}.md").read_text(encoding="utf-8"))) for n in APPENDIX) <= 6000


def test_a_table_takes_the_place_of_that_with_its_heading_and_words_stay():
    part = "Said before.\n\n| a | b |\n|---|---|\n| 1 | 2 |\n\nSaid between.\n\n| c |\n|---|\n| 3 |\n"
    printed = "noise\n\n| c |\n|---|\n| 4 |\n| 5 |\n\n| d |\n|---|\n| 6 |\n"
    assert run.renewed(part, printed) == part.replace("| 3 |", "| 4 |\n| 5 |") + "\n| d |\n|---|\n| 6 |\n"


def test_a_run_changes_its_own_part_alone(tmp_path, monkeypatch):
    page = tmp_path / "docs" / "benchmarks.md"
    page.parent.mkdir()
    old = (
        "# All\n\n## PIV\n\nwords\n\n| a |\n|---|\n| 1 |\n\n### Sigma\n\n| a |\n|---|\n| 2 |\n\n## PIV memory\n\nlast\n"
    )
    page.write_text(old)
    monkeypatch.setattr(run, "ROOT", tmp_path)
    done = SimpleNamespace(returncode=0, stdout="| a |\n|---|\n| 7 |\n", stderr="")
    monkeypatch.setattr(run.subprocess, "run", lambda *a, **k: done)
    run.main("piv_sigma")
    assert page.read_text() == old.replace("| 2 |", "| 7 |")
    run.main("memory")
    assert page.read_text() == old.replace("| 2 |", "| 7 |") + "\n| a |\n|---|\n| 7 |\n"


def test_every_part_that_can_be_run_stands_in_the_page_and_has_its_module():
    page = (DOCS / "benchmarks.md").read_text(encoding="utf-8")
    for name, title in run.PARTS.items():
        begin, end = run.part_of(page, title)
        assert end > begin and (ROOT / "benchmarks" / f"{name}.py").exists(), name
    with pytest.raises(SystemExit):
        run.main("nothing_of_this_name")
