"""No result depends on how pictures are written, turned or inverted: benchmarks/symmetry.py, once. (About 5 s.)"""

from __future__ import annotations

import pytest

import jumpvision as jv
from benchmarks.symmetry import TURNS, WRITTEN, ball, table
from jumpvision.base.schema import InputError
from jumpvision.films.parameters import SMALLEST_BALL


@pytest.fixture(scope="module")
def found():
    return table(seed=0)


@pytest.mark.parametrize("what", ["piv", "track", "bed"])
def test_how_a_picture_is_written_or_turned_changes_nothing(found, what):
    rows = {how: row for (of, how), row in found.items() if of == what}
    assert {*WRITTEN} < {*rows} and (
        what == "bed" or {"mirror", "transpose", "invert"} <= {*rows} <= {*WRITTEN, *TURNS}
    )
    assert {how: row for how, row in rows.items() if not row[0] <= row[1]} == {}


def test_the_smallest_ball_has_one_size():
    """keys.md named 3 px, the tracker refused 6: what the parameters allow, the tracker takes."""
    film = ball()
    with pytest.raises(InputError, match=r"diameter = 5.9: must be in \[6, 2000\] px"):
        jv.track(film, diameter=5.9, polarity="dark")
    assert SMALLEST_BALL == 6.0 and len(jv.track(film[:2], diameter=SMALLEST_BALL, polarity="dark")) == 2
