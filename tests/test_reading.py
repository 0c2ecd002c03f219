"""Guides are easy to read, by a measure that is tested itself."""

from __future__ import annotations

import pytest

from benchmarks.reading import GUIDES, ease, of_guide, syllables


@pytest.mark.parametrize("guide", GUIDES)
def test_a_guide_reads_easily(guide):
    assert of_guide(guide) >= 55


def test_the_measure_is_that_of_flesch():
    """Six words and six syllables in a sentence; hard prose is far below the bar; tables and code do not count."""
    assert ease("The cat sat on the mat.") == pytest.approx(206.835 - 1.015 * 6 - 84.6)
    hard = "The experimental characterisation necessitates simultaneous consideration of instrumental uncertainties."
    assert ease(hard) < 0
    assert ease(f"The cat sat on the mat.\n\n| {hard} |\n\n```bash\n{hard}\n```\n") == ease("The cat sat on the mat.")
    counts = {"table": 2, "measured": 2, "recorded": 3, "matches": 2, "phase": 1, "uncertainty": 4, "velocity": 4}
    assert {w: syllables(w) for w in counts} == counts
