"""The page of benchmarks names every benchmark."""

from __future__ import annotations

import re

from conftest import ROOT


def test_every_benchmark_stands_in_the_page():
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    there = {f.stem for f in (ROOT / "benchmarks").glob("*.py")} - {"__init__", "run"} | {"causes"}
    assert {*re.findall(r"benchmarks\.(\w+)", page)} - {"run", "md"} == there
