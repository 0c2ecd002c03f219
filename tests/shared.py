"""What test files of all folders share: places, and cases that are left to the second run."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "data_samples"


def later(*cases: object) -> list:
    """Cases of a parameter that are left to the second run, `-m long`; the first has others of the same test."""
    return [pytest.param(*(c if isinstance(c, tuple) else (c,)), marks=pytest.mark.long) for c in cases]
