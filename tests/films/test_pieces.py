"""Rows that are no part of a ball's way are flagged; those that are stay. Tracks written down, not drawn."""

from __future__ import annotations

import numpy as np
import pytest

from jumpvision.films.vision.ball.pieces import in_pieces
from jumpvision.films.vision.ball.track import BallTrack

N, D = 40, 12.0


def track(lost=(), **changes):
    """A toss of 40 rows, 10 px a frame, some of them lost, some columns changed: column={row: value}."""
    i = np.arange(N)
    rng = np.random.default_rng(3)
    columns = {"x": 20.0 + 10.0 * i, "y": 300.0 - 16.0 * i + 0.4 * i**2, "diameter": D + 0.02 * rng.normal(size=N)}
    columns |= {"grey": 200.0 + 0.3 * rng.normal(size=N), "contrast": np.full(N, 120.0)}
    for name, values in changes.items():
        for row, value in values.items():
            columns[name][row] = value
    flag = np.array(["lost: no ball found" if k in lost else "" for k in i])
    columns = {k: np.where(flag == "", v, np.nan) for k, v in columns.items()}
    x, y, size, grey, contrast = (columns[k] for k in ("x", "y", "diameter", "grey", "contrast"))
    return BallTrack(x, y, 0.02 + 0 * x, size, 1 + 0 * x, flag, (), grey, contrast)


@pytest.mark.parametrize("clicked", [True, False])
def test_a_ball_that_is_lost_bounces_or_rests_keeps_its_rows(clicked):
    turn = {k: 300.0 - 16.0 * 20 + 0.4 * 400 + 16.0 * (k - 20) for k in range(20, N)}  # back down, as from a wall
    rest = dict.fromkeys(range(10), 187.0), dict.fromkeys(range(10), 112.0)  # and is thrown
    for made in (track(), track(lost=(5, 6, 20)), track(y=turn), track(y=rest[0], x=rest[1])):
        assert in_pieces(made, clicked) is made


def test_a_row_without_a_neighbour_is_flagged():
    made = track(lost=range(10, 20), x={15: 20.0}, y={15: 40.0})
    flag = np.where(np.arange(N) == 15, "", made.flag)
    made = BallTrack(
        np.where(np.arange(N) == 15, 20.0, made.x), np.where(np.arange(N) == 15, 40.0, made.y), np.full(N, 0.02),
        np.full(N, D), np.ones(N), flag,
    )  # fmt: skip
    out = in_pieces(made, False)
    assert "no neighbour" in out.flag[15] and np.isnan(out.x[15])
    assert (np.flatnonzero(out.flag == "") == np.r_[0:10, 20:N]).all()


def test_two_rows_far_apart_are_no_way():
    made = track(
        lost=[k for k in range(10, 20) if k not in (14, 15)], x={14: 260.0, 15: 150.0}, y={14: 90.0, 15: 180.0}
    )
    out = in_pieces(made, True)
    assert all("no neighbour" in f for f in out.flag[[14, 15]]) and (out.flag[:10] == "").all()


def test_a_row_off_the_way_of_its_neighbours_is_flagged():
    """By two thirds of a diameter, in a parabola that the others keep to; a bounce is none such."""
    out = in_pieces(track(x={17: 20.0 + 170.0 + 8.0}), True)
    assert (np.flatnonzero(out.flag != "") == [17]).all() and "off the way of its neighbours by 8 px" in out.flag[17]


def test_a_short_piece_that_stands_is_flagged():
    still = range(25, 31)
    out = in_pieces(track(x=dict.fromkeys(still, 30.0), y=dict.fromkeys(still, 50.0)), True)
    assert all("stand still" in f for f in out.flag[25:31])
    assert (out.flag[[*range(25), *range(31, N)]] == "").all()


def test_another_grey_after_a_jump_is_flagged():
    """From row 26 on it follows another disc: 60 px away, grey 150 for 200."""
    rows = range(26, N)
    made = track(y={k: 300.0 - 16.0 * k + 0.4 * k**2 + 60.0 for k in rows}, grey=dict.fromkeys(rows, 150.0))
    out = in_pieces(made, True)
    assert (out.flag[:26] == "").all() and all("another thing (grey 150 instead of 200" in f for f in out.flag[26:])
