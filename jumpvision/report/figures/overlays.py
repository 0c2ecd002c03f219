"""Films of results drawn over their pictures: small VP8 .webm files, which every browser plays."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Image
from jumpvision.base.progress import watch
from jumpvision.experiment.inputs.parameters import OverlayParams
from jumpvision.experiment.inputs.sections import Calibration, GrainVideo, NotApplicable, RodVideo
from jumpvision.experiment.results.fields import Column, Flow, Piv, Planes, unit_of
from jumpvision.experiment.results.tables import Track
from jumpvision.experiment.stages.recordings import open_film, open_grains
from jumpvision.experiment.workflow.stage import stage
from jumpvision.films.grains.grid import VectorGrid

from .pictures import Picture, shrunk

Bgr = NDArray[np.uint8]

MOST = 300  # frames shown; a longer film is thinned evenly
RATE = 25.0  # frames a second, fewer for short films
WIDTH = 720  # px; smaller films are enlarged by a whole number, larger ones shrunk
SHOWN = ("u", "v", "chc", "foot_y")  # of a field
STRIP = 22  # px below the picture, for time and scale
SHIFT = 4  # bits of sub-pixel drawing


class Quality(NamedTuple):
    """How a film is coded: bits a second, and options of libvpx."""

    bits: int
    options: dict[str, str]


# a negative speed is kept, a positive one follows the clock; one thread: how many there are changes the bytes
FIXED = {"deadline": "realtime", "cpu-used": "-6", "threads": "1"}
LINES = Quality(2_000_000, {**FIXED, "crf": "18"})
FIELDS = Quality(1_500_000, {**FIXED, "crf": "20"})


def webm(pictures: Iterable[Bgr], rate: float, quality: Quality = FIELDS) -> bytes:
    """VP8 film of pictures (H, W, 3) BGR, H and W even; without a date: the same pictures give the same bytes."""
    import av

    out = io.BytesIO()
    with av.open(out, "w", format="webm", options={"fflags": "+bitexact"}) as film:
        stream: Any = None
        for picture in pictures:
            if stream is None:
                stream = film.add_stream("libvpx", rate=Fraction(rate).limit_denominator(1000))
                stream.height, stream.width = picture.shape[:2]
                stream.pix_fmt, stream.bit_rate = "yuv420p", quality.bits
                stream.options = dict(quality.options)
            film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        if stream is not None:
            film.mux(stream.encode())
    return out.getvalue()


# -- the ball ----------------------------------------------------------------------------------------------------------

LONG_SIDE = 1280  # px at most, about, by whole factors: large films are shrunk
COLOURS = ((60, 220, 60), (60, 160, 255), (255, 120, 200))  # of the balls in turn; BGR
LOST = (60, 60, 255)


class TrackFilm(Picture):
    """The film of the ball with its track drawn in, to check by eye."""

    file = "track.webm"


@stage(version=4, picture=True)
def overlay(track: Track, film: RodVideo, *, p: OverlayParams) -> TrackFilm:
    """Every p.every-th frame, or MOST evenly, with a cross and path for each ball, or the reason why it was lost."""
    if p.every == 0:
        raise NotApplicable(["overlay.every = 0: no film of the track is asked for"])
    with open_film(film) as frames:
        shown = range(0, len(frames), p.every or -(-len(frames) // MOST))
        found = track.good if len(track.good) else track.table
        ball = found.iloc[len(found) // 2]
        white = brightness(frames[int(ball.frame)], ball)
        factor = round(360 / min(frames.shape)) or 1  # small films are enlarged to 360 px, by whole factors
        pictures = (frame_with_path(frames[i], (track.table, *track.others), i, white, factor) for i in shown)
        return TrackFilm(webm(watch(pictures, "frames drawn", len(shown)), RATE, LINES))


def brightness(image: Image, ball: pd.Series) -> float:
    """Grey that is shown white: few pixels are brighter, and a ball (its row of the track) is not, however small."""
    white = float(np.nanpercentile(shrunk(image, LONG_SIDE), 99.9))
    if np.isfinite(ball.x_px) and np.isfinite(ball.y_px):
        row, column = (max(0, round(float(q)) - 2) for q in (ball.y_px, ball.x_px))
        about = image[row : row + 5, column : column + 5]
        white = max(white, float(np.nanmedian(about)) if about.size else 0.0)
    return max(1.0, white)


def frame_with_path(image: Image, tables: Sequence[pd.DataFrame], i: int, white: float, factor: int) -> Bgr:
    """Frame i (row, column, BGR), enlarged or shrunk, with the balls' positions; even sides, as the codec needs."""
    small = shrunk(image, LONG_SIDE)
    zoom, image = factor / (max(image.shape) // max(small.shape)), small
    grey = np.clip(np.nan_to_num(image) * (255.0 / white), 0, 255).astype(np.uint8)
    big = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    out = cv2.cvtColor(big[: big.shape[0] // 2 * 2, : big.shape[1] // 2 * 2], cv2.COLOR_GRAY2BGR)
    for k, table in enumerate(tables):
        colour = COLOURS[k % len(COLOURS)]
        # pixel centres at integers: the centre of pixel 0 lies at (zoom - 1)/2 in the picture shown
        # 100 frames of path behind the ball
        path = (table[["x_px", "y_px"]].to_numpy(float)[max(0, i - 100) : i + 1] + 0.5) * zoom - 0.5
        fixed = np.rint(path * 2**SHIFT)
        for a, b in pairwise(fixed):
            if np.isfinite(a).all() and np.isfinite(b).all():
                cv2.line(out, point(a), point(b), colour, 1, cv2.LINE_AA, SHIFT)
        if np.isfinite(fixed[-1]).all():
            for d in ((7, 0), (0, 7)):
                arm = np.array(d) * 2**SHIFT
                cv2.line(out, point(fixed[-1] - arm), point(fixed[-1] + arm), colour, 1, cv2.LINE_AA, SHIFT)
        else:
            text = str(table.flag.iloc[i])
            cv2.putText(out, text, (6, 32 + 14 * k), cv2.FONT_HERSHEY_SIMPLEX, 0.4, LOST, 1, cv2.LINE_AA)
    cv2.putText(out, f"frame {i}", (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(out, dtype=np.uint8)


def point(v: NDArray[np.float64]) -> tuple[int, int]:
    """As OpenCV wants it."""
    return int(v[0]), int(v[1])


# -- the grains --------------------------------------------------------------------------------------------------------


class PivOverlay(Picture):
    """A film of the velocity vectors over the grains."""

    file = "piv.webm"


@stage(version=2, picture=True)
def piv_overlay(piv: Piv, film: GrainVideo, calibration: Calibration | None) -> PivOverlay:
    """Vectors over the grains, in slow motion: coloured where measured, pink where replaced; the foot in blue."""
    shown, grid = thinned(piv.field.sizes["t"]), piv.geometry
    straight, film = open_grains(film, calibration)
    with straight as frames:
        draw = Drawing(piv.field.isel(t=shown), grid, frames[0], film.scale or 1.0)
        pictures = (draw(frames[grid.middle_frame(k, len(frames))], i) for i, k in enumerate(shown))
        return PivOverlay(webm(pictures, rate=slowed(len(shown))))


def thinned(n: int) -> NDArray[np.int64]:
    """Which of n times a film shows: all, or MOST of them evenly."""
    return np.unique(np.linspace(0, n - 1, min(n, MOST)).round().astype(np.int64))


def slowed(n: int) -> float:
    """Frames a second for n frames."""
    return min(RATE, max(1.0, n / 4.0))  # short films last 4 s


class View:
    """Film and field brought to one scale of pixels and one of greys, the same in all frames."""

    def __init__(self, field: xr.Dataset, grid: VectorGrid, image: Image, scale: float):
        self.planes = Planes(field, [n for n in SHOWN if n in field])
        self.low, self.high = (float(q) for q in np.nanpercentile(shrunk(image), (0.5, 99.5)))
        rows, columns = image.shape
        self.zoom = WIDTH // columns or WIDTH / columns
        self.size = tuple(int(n * self.zoom) // 2 * 2 for n in (columns, rows))  # even, as the codec asks
        self.scale, self.grid = scale, grid
        self.face = self.row_of(field.foot_y.values) if "foot_y" in field else None

    def column_of(self, x: Array) -> Array:
        """Column in the film's picture of x [m]."""
        return (x / self.scale + self.grid.origin_column_px + 0.5) * self.zoom

    def row_of(self, y: Array) -> Array:
        """Row in the film's picture of y [m], up."""
        return (self.grid.origin_row_px - y / self.scale + 0.5) * self.zoom

    def grains(self, image: Image, white: float) -> Bgr:
        """A frame (row, column, BGR) with `white` as its brightest grey."""
        grey = np.clip(
            (shrunk(image).astype(np.float32) - self.low) * (white / max(self.high - self.low, 1e-6)), 0, white
        )
        way = cv2.INTER_NEAREST if self.zoom >= 1 else cv2.INTER_AREA
        small = cv2.resize(np.nan_to_num(grey).astype(np.uint8), self.size, interpolation=way)
        return cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)

    def draw_face(self, picture: Image, i: int) -> None:
        """The foot's lower face at time i, in blue."""
        if self.face is not None and np.isfinite(self.face[i]):
            y = round(float(self.face[i]))
            cv2.line(picture, (0, y), (self.size[0], y), (178, 114, 0), 1, cv2.LINE_AA)


class Drawing(View):
    """The vectors, at one scale of arrows in all frames."""

    def __init__(self, field: xr.Dataset, grid: VectorGrid, image: Image, scale: float):
        super().__init__(field, grid, image, scale)
        every = max(1, -(-field.sizes["x"] // 32))  # arrows along a row, at most
        self.part = {"x": slice(every // 2, None, every), "y": slice(every // 2, None, every)}
        self.column, self.row = self.column_of(field.x.values), self.row_of(field.y.values)
        tops = [np.nanmax(s) for s in map(self.speed, self.planes) if np.isfinite(s).any()]
        self.top = float(np.quantile(tops, 0.95)) if tops and max(tops) > 0 else 1.0
        apart = abs(self.column[every] - self.column[0]) if field.sizes["x"] > every else 16 * self.zoom
        self.length, self.unit = 2.0 * apart / self.top, unit_of(field.u)  # px per unit of speed

    @staticmethod
    def speed(f: xr.Dataset) -> NDArray[np.float64]:
        """99 % of the measured speeds of a time lie below its largest value."""
        s = np.hypot(f.u.values, f.v.values)[f.chc.values > 0]
        return np.asarray(s[s <= np.quantile(s, 0.99)] if s.size else np.array([np.nan]))

    def __call__(self, image: Image, i: int) -> Bgr:
        picture = self.grains(image, 200.0)
        f = self.planes[i].isel(self.part)
        u, v, measured = f.u.values, f.v.values, f.chc.values > 0
        speed = np.clip(255 * np.nan_to_num(np.hypot(u, v)) / self.top, 0, 255).astype(np.uint8)
        colours = cv2.applyColorMap(speed, cv2.COLORMAP_TURBO)
        row, column = self.row[self.part["y"]], self.column[self.part["x"]]
        for j, k in np.argwhere(np.isfinite(u)):
            colour = tuple(int(c) for c in colours[j, k]) if measured[j, k] else (167, 121, 204)
            arrow(picture, column[k], row[j], self.length * u[j, k], -self.length * v[j, k], colour)
        self.draw_face(picture, i)
        return self.legend(picture, float(f.t))

    def legend(self, picture: Image, t: float) -> Bgr:
        """The picture over a strip with the time, and an arrow with its speed."""
        value = float(f"{self.top:.1g}")
        text = f"t = {t:.4f} s     {value:g} {self.unit}"
        picture = captioned(picture, text)
        height = picture.shape[0]
        (wide, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
        arrow(picture, wide + 20, height - 11, self.length * value, 0, (255, 255, 255))
        return np.asarray(picture, np.uint8)


def captioned(picture: Image, text: str) -> Bgr:
    """The picture over a strip with a text."""
    out = cv2.copyMakeBorder(picture, 0, STRIP, 0, 0, cv2.BORDER_CONSTANT, value=(0, 0, 0))
    at = (8, out.shape[0] - 7)
    cv2.putText(out, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(out, np.uint8)


def arrow(picture: Image, x: float, y: float, dx: float, dy: float, colour: tuple[int, ...]) -> None:
    """An arrow from (x, y) [px], to a sixteenth of a pixel; a dot where it would be shorter than 2 px."""
    start, end = (tuple(round(16 * float(q)) for q in p) for p in ((x, y), (x + dx, y + dy)))
    length = float(np.hypot(dx, dy))
    if length < 2:
        cv2.circle(picture, start, 12, colour, -1, cv2.LINE_AA, 4)
    else:
        cv2.arrowedLine(picture, start, end, colour, 1, cv2.LINE_AA, 4, min(0.4, 5 / length))


# -- the growing cone --------------------------------------------------------------------------------------------------

GREEN, WHITE, PINK = (115, 158, 0), (255, 255, 255), (167, 121, 204)  # BGR


class ConeOverlay(Picture):
    """A VP8 film."""

    file = "cone.webm"


@stage(version=2, picture=True)
def cone_overlay(
    flow: Flow, piv: Piv, film: GrainVideo, column: Column | None, calibration: Calibration | None
) -> ConeOverlay:
    """Shear rate in colour where it is strong, white dots on its ridges, green sides of the cone, the foot in blue."""
    if "foot_y" not in piv.field:
        raise NotApplicable(["cone_overlay needs foot_row and axis_column of [grain_video]"])
    shown, grid = thinned(piv.field.sizes["t"]), piv.geometry
    straight, film = open_grains(film, calibration)
    with straight as frames:
        sides = column.field.isel(t=shown) if column is not None else None
        draw = ConeDrawing(
            piv.field.isel(t=shown), grid, flow.field.shear_rate.isel(t=shown), sides, frames[0], film.scale or 1.0
        )
        pictures = (draw(frames[grid.middle_frame(k, len(frames))], i) for i, k in enumerate(shown))
        return ConeOverlay(webm(pictures, rate=slowed(len(shown))))


class ConeDrawing(View):
    """shear (y, x, t) [1/s] on the field's grid; sides: the column's record of the same times, or None."""

    def __init__(
        self,
        field: xr.Dataset,
        grid: VectorGrid,
        shear: xr.DataArray,
        sides: xr.Dataset | None,
        image: Image,
        scale: float,
    ):
        super().__init__(field, grid, image, scale)
        self.shear, self.sides = Planes(shear.to_dataset(name="shear_rate")), sides
        each = (f.shear_rate.values for f in self.shear)
        tops = [np.nanquantile(s, 0.99) for s in each if np.isfinite(s).any()]
        self.top = float(np.quantile(tops, 0.9)) if tops and max(tops) > 0 else 1.0
        x, y = self.column_of(shear.x.values), self.row_of(shear.y.values)
        # from a pixel of the picture to the grid, of equal steps
        wide, high = self.size
        self.at = (
            np.tile(((np.arange(wide) + 0.5 - x[0]) / (x[1] - x[0])).astype(np.float32), (high, 1)),
            np.tile(((np.arange(high) + 0.5 - y[0]) / (y[1] - y[0])).astype(np.float32)[:, None], (1, wide)),
        )

    def __call__(self, image: Image, i: int) -> Bgr:
        picture = self.grains(image, 170.0)
        grid = self.shear[i].shear_rate.transpose("y", "x").values
        share = cv2.remap(
            np.nan_to_num(grid / self.top).astype(np.float32), *self.at, cv2.INTER_LINEAR, borderValue=0.0
        )
        share = np.clip(share, 0.0, 1.0)
        if self.face is not None and np.isfinite(self.face[i]):
            share[: max(0, round(float(self.face[i])))] = 0.0  # above it the foot's edges and the air, not grains
        colours = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_INFERNO)
        # below 6 % of the scale grains show through as they are
        weight = np.clip((share - 0.06) / 0.3, 0.0, 0.8)[..., None]
        picture = (picture * (1.0 - weight) + colours * weight).astype(np.uint8)
        self.draw_face(picture, i)
        if self.sides is not None:
            self.draw_sides(picture, self.sides.isel(t=i))
        t = float(self.planes[i].t)
        return np.asarray(captioned(picture, f"t = {t:.4f} s     bright: {self.top:.2g} 1/s and more"), np.uint8)

    def draw_sides(self, picture: Image, c: xr.Dataset) -> None:
        """Ridges of the shear rate, outline of the cone, and the straight lines fitted to it."""
        for name, colour in (("ridge", WHITE), ("outline", PINK)):
            for way in ("left", "right"):
                for x, y in zip(self.column_of(c[f"{name}_{way}"].values), self.row_of(c.y.values)):
                    if np.isfinite(x):
                        cv2.circle(picture, self.fixed(x, y), round(1.6 * 2**SHIFT), colour, -1, cv2.LINE_AA, SHIFT)
        theta, radius, thick = np.radians(float(c.theta_deg)), float(c.cone_radius), float(c.jammed_thickness)
        if not np.isfinite([theta, radius, thick]).all():
            return
        face = float(c.depth[0] + c.y[0])
        depth = min(thick, radius * np.tan(theta))
        low = radius - depth / np.tan(theta)
        corners = [(-radius, face), (-low, face - depth), (low, face - depth), (radius, face)]
        points = np.array([self.fixed(self.column_of(x), self.row_of(y)) for x, y in corners], np.int32)
        cv2.polylines(picture, [points], False, GREEN, 2, cv2.LINE_AA, SHIFT)

    def fixed(self, x: float | Array, y: float | Array) -> tuple[int, int]:
        """A place in the picture as OpenCV wants it."""
        return round(float(x) * 2**SHIFT), round(float(y) * 2**SHIFT)
