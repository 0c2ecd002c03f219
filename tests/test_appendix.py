"""The appendix of docs/: few words, tables that one command makes anew and leaves the words around them alone."""

from __future__ import annotations

import re

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


OLD = (
    "# All\n\n## Machine\n\nsaid\n\n## PIV\n\nwords\n\n| a |\n|---|\n| 1 |\n\n### Sigma\n\n| a |\n|---|\n| 2 |\n\n"
    "## PIV memory\n\nlast\n"
)


def test_what_is_slower_than_the_page_says_and_rows_that_are_gone_are_said():
    def table(*rows):
        return "".join(f"| {line} |\n" for line in ("case | noise | ours | error", "---|---|---|---", *rows))

    part = table("a | 2 | 1,000 us | 0.003", "a | 5 | 400 (rtol 1) | 0.2", "b | 2 | 10 | none")
    slower = table("a | 2 | 1,300 us | 0.009", "a | 5 | 480 (rtol 1) | 0.1", "b | 2 | 9 | none")
    assert run.changed(part, slower) == ["a, 2; ours: 1,000 us -> 1,300 us", "a, 5; error: 0.2 -> 0.1"]
    assert run.changed(part, table("a | 2 | 1 | 1", "a | 5 | 1 | 1")) == ["b: no longer there"]
    assert run.changed(part, part) == run.changed("", part) == []
    without = table("a | 2 | 1,000 us | ", "a | 5 | 500 | 0.2", "b | 2 | 10 | none")  # a peer is not installed
    assert run.renewed(part, without) == part and "stays" in run.changed(part, without)[0]


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A page of three parts and tiny benchmarks of two; what is printed has a table, words, and signs beyond ASCII."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "benchmarks").mkdir()
    (tmp_path / "benchmarks" / "__init__.py").write_text("")
    said = "import sys\nprint('busy')\nprint('| a |\\n|---|\\n| 7 ± {} |')\nsys.exit({})\n"
    (tmp_path / "benchmarks" / "piv_sigma.py").write_text(said.format(1, 0), encoding="utf-8")
    (tmp_path / "benchmarks" / "memory.py").write_text(said.format(2, 0), encoding="utf-8")
    (tmp_path / "benchmarks" / "piv.py").write_text(said.format(3, 1), encoding="utf-8")
    file = tmp_path / "docs" / "benchmarks.md"
    file.write_text(OLD, encoding="utf-8")
    monkeypatch.setattr(run, "ROOT", tmp_path)
    return file


def test_a_run_changes_its_own_part_alone(page):
    run.main("piv_sigma")
    assert page.read_text(encoding="utf-8") == OLD.replace("| 2 |", "| 7 ± 1 |")
    run.main("memory")
    assert page.read_text(encoding="utf-8") == OLD.replace("| 2 |", "| 7 ± 1 |") + "\n| a |\n|---|\n| 7 ± 2 |\n"


def test_the_quick_run_writes_the_peers_tables_and_the_machine_and_nothing_else(page, monkeypatch, capsys):
    monkeypatch.setattr(run, "QUICK", ("piv_sigma", "memory"))
    monkeypatch.setattr(run, "reference", lambda: 0.25)
    run.main("--quick")
    first = page.read_text(encoding="utf-8")
    table = run.TABLE.search(first)[0]
    assert "| R, 2e7 turns of a loop that counts, before and after | 0.25, 0.25 s |" in table
    assert all(f"| {name} | " in table for name in ("cores", "Python", "jumpvision", *run.PEERS))
    others = OLD.replace("| 2 |", "| 7 ± 1 |") + "\n| a |\n|---|\n| 7 ± 2 |\n"
    assert first.replace("\n" + table, "") == others
    out = capsys.readouterr().out
    assert "busy" in out and "| 7 ± 2 |" in out and "| machine | |" in out  # shown, too
    monkeypatch.setattr(run, "reference", lambda: 0.5)
    run.main("--quick")
    again = page.read_text(encoding="utf-8")
    changed = [a for a, b in zip(first.splitlines(), again.splitlines(), strict=True) if a != b]
    assert 1 <= len(changed) <= 2 and changed[0].startswith("| R, ")  # and the load
    assert all(line.startswith(("| R, ", "| cores ")) for line in changed)


def test_a_benchmark_that_fails_keeps_its_tables_and_is_named(page):
    with pytest.raises(SystemExit, match=r"failed: piv$"):
        run.main("piv", "piv_sigma")
    assert page.read_text(encoding="utf-8") == OLD.replace("| 2 |", "| 7 ± 1 |")


def test_every_part_that_can_be_run_stands_in_the_page_and_has_its_module():
    page = (DOCS / "benchmarks.md").read_text(encoding="utf-8")
    for name, title in run.PARTS.items():
        begin, end = run.part_of(page, title)
        assert end > begin and (ROOT / "benchmarks" / f"{name}.py").exists(), name
    assert set(run.QUICK) <= run.PARTS.keys() and run.part_of(page, run.MACHINE)
    with pytest.raises(SystemExit):
        run.main("nothing_of_this_name")
