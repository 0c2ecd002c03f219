"""The appendix of docs/ has few words, and every benchmark that it names."""

from __future__ import annotations

import re

from conftest import ROOT

DOCS = ROOT / "docs"
APPENDIX = "benchmarks", "features", "real"


def prose(text: str) -> list[str]:
    """Words outside tables and code."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    return " ".join(line for line in text.splitlines() if not line.startswith("|")).split()


def test_the_appendix_has_at_most_4000_words_beside_its_tables():
    index = (DOCS / "README.md").read_text(encoding="utf-8").partition("## Appendix")[2]
    assert set(APPENDIX) == {*re.findall(r"\]\((\w+)\.md\)", index)} - {"keys", "api"}
    assert sum(len(prose((DOCS / f"{n}.md").read_text(encoding="utf-8"))) for n in APPENDIX) <= 4000


def test_every_benchmark_stands_in_the_page():
    page = (DOCS / "benchmarks.md").read_text(encoding="utf-8")
    there = {f.stem for f in (ROOT / "benchmarks").glob("*.py")} - {"__init__", "run"} | {"causes"}
    assert {*re.findall(r"benchmarks\.(\w+)", page)} - {"run", "md"} == there
