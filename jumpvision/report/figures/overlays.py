"""Films of results drawn over their pictures: small VP8 .webm files, which every browser plays."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jumpvision.grains.grid import VectorGrid
from jumpvision.inputs.sections import Calibration, GrainVideo
from jumpvision.results import Record
from jumpvision.results.fields import Piv
from jumpvision.stages.recordings import open_grains
from jumpvision.workflow.stage import stage

Bgr = NDArray[np.uint8]

MOST = 300  # frames shown; a longer film is thinned evenly
RATE = 25.0  # frames a second, fewer for short films, so that they last SHORTEST
SHORTEST = 4.0  # s
WIDTH = 720  # px; smaller films are enlarged by a whole number, larger ones shrunk
ARROWS = 32  # along a row at most
STRIP = 22  # px below the picture, for time and scale
BITS = 1_500_000  # a second of film


@dataclass(frozen=True)
class PivOverlay(Record):
    """A film of the velocity vectors over the grains."""

    file = "piv.webm"
    webm: bytes

    def save(self, folder: Path) -> None:
        (folder / self.file).write_bytes(self.webm)

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls((folder / cls.file).read_bytes())


@stage(version=1, picture=True)
def piv_overlay(piv: Piv, film: GrainVideo, calibration: Calibration | None) -> PivOverlay:
    """Vectors over the grains, in slow motion: coloured where measured, pink where replaced; the foot in blue."""
    shown, grid = thinned(piv.field.sizes["t"]), piv.geometry
    straight, film = open_grains(film, calibration)
    with straight as frames:
        draw = Drawing(piv.field.isel(t=shown), grid, frames[0], film.scale or 1.0)
        pictures = (draw(frames[frame_of(grid, k, len(frames))], i) for i, k in enumerate(shown))
        return PivOverlay(webm(pictures, rate=slowed(len(shown))))


def thinned(n: int) -> NDArray[np.int64]:
    """Which of n times a film shows: all, or MOST of them evenly."""
    return np.unique(np.linspace(0, n - 1, min(n, MOST)).round().astype(np.int64))


def slowed(n: int) -> float:
    """Frames a second for n frames."""
    return min(RATE, max(1.0, n / SHORTEST))


def frame_of(grid: VectorGrid, k: int, n: int) -> int:
    """The frame in the middle of those that the field at time k was made from, of n frames."""
    every, gap = int(grid.ensemble_pairs), int(grid.gap_frames)
    return min(int(k) * every + (every + gap - 1) // 2, n - 1)


class View:
    """Film and field brought to one scale of pixels and one of greys, the same in all frames."""

    def __init__(self, field: xr.Dataset, grid: VectorGrid, image: NDArray[Any], scale: float):
        self.field, self.low, self.high = field, *(float(q) for q in np.nanpercentile(image, (0.5, 99.5)))
        rows, columns = image.shape
        self.zoom = WIDTH // columns or WIDTH / columns
        self.size = tuple(int(n * self.zoom) // 2 * 2 for n in (columns, rows))  # even, as the codec asks
        self.scale, self.grid = scale, grid
        self.face = self.row_of(field.foot_y.values) if "foot_y" in field else None

    def column_of(self, x: Any) -> Any:
        """Column in the film's picture of x [m]."""
        return (x / self.scale + self.grid.origin_column_px + 0.5) * self.zoom

    def row_of(self, y: Any) -> Any:
        """Row in the film's picture of y [m], up."""
        return (self.grid.origin_row_px - y / self.scale + 0.5) * self.zoom

    def grains(self, image: NDArray[Any], white: float) -> Any:
        """A frame (row, column, BGR) with `white` as its brightest grey."""
        grey = np.clip((image.astype(np.float32) - self.low) * (white / max(self.high - self.low, 1e-6)), 0, white)
        way = cv2.INTER_NEAREST if self.zoom >= 1 else cv2.INTER_AREA
        small = cv2.resize(np.nan_to_num(grey).astype(np.uint8), self.size, interpolation=way)
        return cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)

    def draw_face(self, picture: Any, i: int) -> None:
        """The foot's lower face at time i, in blue."""
        if self.face is not None and np.isfinite(self.face[i]):
            y = round(float(self.face[i]))
            cv2.line(picture, (0, y), (self.size[0], y), (178, 114, 0), 1, cv2.LINE_AA)


class Drawing(View):
    """The vectors, at one scale of arrows in all frames."""

    def __init__(self, field: xr.Dataset, grid: VectorGrid, image: NDArray[Any], scale: float):
        super().__init__(field, grid, image, scale)
        every = max(1, -(-field.sizes["x"] // ARROWS))
        self.part = {"x": slice(every // 2, None, every), "y": slice(every // 2, None, every)}
        self.column, self.row = self.column_of(field.x.values), self.row_of(field.y.values)
        tops = [np.nanmax(s) for s in map(self.speed, range(field.sizes["t"])) if np.isfinite(s).any()]
        self.top = float(np.quantile(tops, 0.95)) if tops and max(tops) > 0 else 1.0
        apart = abs(self.column[every] - self.column[0]) if field.sizes["x"] > every else 16 * self.zoom
        self.length = 2.0 * apart / self.top  # px per unit of speed

    def speed(self, i: int) -> NDArray[np.float64]:
        """99 % of the measured speeds of time i lie below its largest value."""
        f = self.field.isel(t=i)
        s = np.hypot(f.u.values, f.v.values)[f.chc.values > 0]
        return np.asarray(s[s <= np.quantile(s, 0.99)] if s.size else np.array([np.nan]))

    def __call__(self, image: NDArray[Any], i: int) -> Bgr:
        picture = self.grains(image, 200.0)
        f = self.field.isel({"t": i, **self.part})
        u, v, measured = f.u.values, f.v.values, f.chc.values > 0
        speed = np.clip(255 * np.nan_to_num(np.hypot(u, v)) / self.top, 0, 255).astype(np.uint8)
        colours = cv2.applyColorMap(speed, cv2.COLORMAP_TURBO)
        row, column = self.row[self.part["y"]], self.column[self.part["x"]]
        for j, k in np.argwhere(np.isfinite(u)):
            colour = tuple(int(c) for c in colours[j, k]) if measured[j, k] else (167, 121, 204)
            arrow(picture, column[k], row[j], self.length * u[j, k], -self.length * v[j, k], colour)
        self.draw_face(picture, i)
        return self.legend(picture, float(f.t))

    def legend(self, picture: Any, t: float) -> Bgr:
        """The picture over a strip with the time, and an arrow with its speed."""
        value = float(f"{self.top:.1g}")
        text = f"t = {t:.4f} s     {value:g} {self.grid.unit}/s"
        picture = captioned(picture, text)
        height = picture.shape[0]
        (wide, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
        arrow(picture, wide + 20, height - 11, self.length * value, 0, (255, 255, 255))
        return np.asarray(picture, np.uint8)


def captioned(picture: Any, text: str) -> Any:
    """The picture over a strip with a text."""
    out = cv2.copyMakeBorder(picture, 0, STRIP, 0, 0, cv2.BORDER_CONSTANT, value=(0, 0, 0))
    at = (8, out.shape[0] - 7)
    return cv2.putText(out, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)


def arrow(picture: Any, x: float, y: float, dx: float, dy: float, colour: tuple[int, ...]) -> None:
    """An arrow from (x, y) [px], to a sixteenth of a pixel; a dot where it would be shorter than 2 px."""
    start, end = (tuple(round(16 * float(q)) for q in p) for p in ((x, y), (x + dx, y + dy)))
    length = float(np.hypot(dx, dy))
    if length < 2:
        cv2.circle(picture, start, 12, colour, -1, cv2.LINE_AA, 4)
    else:
        cv2.arrowedLine(picture, start, end, colour, 1, cv2.LINE_AA, 4, min(0.4, 5 / length))


def webm(pictures: Iterable[Bgr], rate: float) -> bytes:
    """VP8 film of pictures (H, W, 3) BGR, H and W even; without a date: the same pictures give the same bytes."""
    import av

    out = io.BytesIO()
    with av.open(out, "w", format="webm", options={"fflags": "+bitexact"}) as film:
        stream: Any = None
        for picture in pictures:
            if stream is None:
                stream = film.add_stream("libvpx", rate=Fraction(rate).limit_denominator(1000))
                stream.height, stream.width = picture.shape[:2]
                stream.pix_fmt, stream.bit_rate = "yuv420p", BITS
                stream.options = {"deadline": "good", "cpu-used": "4", "crf": "20"}
            film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        if stream is not None:
            film.mux(stream.encode())
    return out.getvalue()
