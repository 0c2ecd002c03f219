"""The film of vectors over the grains: what is drawn where, and a file that browsers play."""

import io

import av
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from jumpvision.films.grains.grid import VectorGrid
from jumpvision.report.figures import overlays
from jumpvision.report.figures.overlays import FIELDS, LINES, STRIP, Drawing, webm
from jumpvision.report.figures.pictures import shrunk

ROWS, COLUMNS, SCALE = 80, 90, 1e-3  # px, px, m/px
GRID = VectorGrid(delta_t=0.01, source="drawn", scale_m_per_px=SCALE, origin_column_px=45.0, origin_row_px=10.0,
                  window_px=16, step_px=16, error_correlation_length_px=16,
                  image_rows=ROWS, image_columns=COLUMNS)  # fmt: skip


def field(u, v, chc, n=2):
    """One vector, 30 mm below the origin, at pixel (45, 40), for n times."""
    shape = ("y", "x", "t")
    full = [np.full((1, 1, n), float(f)) for f in (u, v, chc)]
    return xr.Dataset(
        {"u": (shape, full[0], {"units": "m/s"}), "v": (shape, full[1]), "chc": (shape, full[2])},
        coords={"x": [0.0], "y": [-0.03], "t": np.arange(n) * 0.01},
    )


def drawn(u, v, chc=1.0):
    """Rows and columns, in pixels of the frame, of what is drawn, and its colours (BGR)."""
    draw = Drawing(field(u, v, chc), GRID, np.tile(np.uint8([0, 200]), (ROWS, COLUMNS // 2)), SCALE)
    picture = draw(np.zeros((ROWS, COLUMNS), np.uint8), 0)[:-STRIP].astype(int)
    seen = np.ptp(picture, axis=2) > 40  # colour, where the frame is grey
    row, column = np.nonzero(seen)
    return (row + 0.5) / draw.zoom - 0.5, (column + 0.5) / draw.zoom - 0.5, picture[seen]


@pytest.mark.parametrize(("u", "v"), [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_an_arrow_starts_at_its_place_and_points_up_for_positive_v(u, v):
    row, column, _ = drawn(u, v)
    along = (column - 45) * u + (40 - row) * v
    across = (column - 45) * v + (row - 40) * u
    # one vector: twice 16 px at the largest speed; the pen is a film pixel (an eighth) wide and smoothed over one more
    assert along.min() == pytest.approx(0, abs=0.25) and along.max() == pytest.approx(32, abs=0.3)
    assert abs(across.mean()) < 0.2


def test_replaced_vectors_are_pink_and_missing_ones_absent():
    blue, green, red = drawn(1, 0, chc=0.0)[2].mean(0)
    assert red > blue > green
    assert len(drawn(np.nan, np.nan)[0]) == 0


def test_the_film_is_vp8_with_every_picture_and_the_same_each_time():
    rng = np.random.default_rng(1)
    base = rng.integers(0, 255, (8, 12, 3), np.uint8).repeat(8, 0).repeat(8, 1)
    pictures = [np.roll(base, 8 * k, axis=1) for k in range(7)]
    data = webm(pictures, rate=5.0)
    assert data == webm(pictures, rate=5.0)
    # a speed, not a share of the time between two pictures, by which a busy machine's films differed
    assert all(int(quality.options["cpu-used"]) < 0 for quality in (LINES, FIELDS))
    with av.open(io.BytesIO(data)) as film:
        frames = [f.to_ndarray(format="bgr24") for f in film.decode(video=0)]
        assert film.streams.video[0].codec_context.name == "vp8" and film.streams.video[0].average_rate == 5
    assert len(frames) == 7
    # grey of blocks of 8 px through a codec for small films: a few levels; colour is halved in size
    assert max(np.abs(f.mean(2) - p.mean(2)).mean() for f, p in zip(frames, pictures)) < 12


@pytest.mark.parametrize(("rows", "columns", "factor", "zoom"), [(2049, 2603, 1, 1 / 2), (60, 90, 6, 6.0)])
def test_the_cross_lies_where_the_ball_is_in_frames_shrunk_and_enlarged(rows, columns, factor, zoom):
    """One block of 24 px is bright; the cross is drawn at the same place, to a pixel of what is shown."""
    image = np.zeros((rows, columns), np.uint16)
    top = min(rows // 2, 124) - 6  # below the text
    image[top : top + 24, 48:72] = 1000
    table = pd.DataFrame({"x_px": [59.5], "y_px": [top + 11.5], "flag": [""]})
    picture = overlays.frame_with_path(image, [table], 0, 1000.0, factor).astype(int)
    assert max(picture.shape) < 2 * overlays.LONG_SIDE
    cross = np.argwhere(np.ptp(picture, axis=2) > 60)
    wanted = (np.array([top + 11.5, 59.5]) + 0.5) * zoom - 0.5
    assert np.abs(cross.mean(axis=0) - wanted).max() < 0.5
    row, column = np.rint(wanted - 8 * zoom).astype(int)
    assert picture[row, column].min() > 200  # the ball beneath it


def test_a_shrunk_frame_is_the_means_of_its_blocks():
    image = np.random.default_rng(0).integers(0, 4095, (3205, 3301), np.uint16)
    small = shrunk(image, 1600)
    assert small.shape == (1602, 1650)
    assert small[5, 7] == pytest.approx(image[10:12, 14:16].mean(), abs=1e-3)
    assert shrunk(image[:1600, :1600]).shape == (1600, 1600) and shrunk(np.ones((3, 9000), np.uint8)).shape == (1, 3000)


def test_a_small_bright_ball_on_a_dark_wide_frame_is_what_is_shown_white():
    """One pixel of a thousand was brighter than the ground, and all of the film was white."""
    image = np.full((400, 600), 30, np.uint8)
    image[100:108, 200:208] = 230
    row = pd.DataFrame({"x_px": [203.5], "y_px": [103.5]}).iloc[0]
    assert overlays.brightness(image, row) == 230
    image[300, 300] = 255  # a hot pixel is none
    assert overlays.brightness(image, row) == 230
    assert overlays.brightness(image, row * np.nan) == 30
