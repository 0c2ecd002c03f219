"""The laboratory's cameras: lens, glass and reflections; the chip's blur, photon and read noise, 8-bit rounding."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array


@dataclass(frozen=True)
class Chip:
    """What may be wrong with any camera."""

    bits: int = 8  # of a pixel; 8, 12 or 16
    shading: float = 0.0  # how much darker the corners are than the middle, 0..1
    k1: float = 0.0  # 1/px^2, lens: true offset = seen offset x (1 + k1 r^2 + k2 r^4)
    k2: float = 0.0  # 1/px^4
    calibrated: bool = False  # whether the lens is declared in [calibration]
    scale_error: float = 0.0  # declared scale / true scale - 1

    def __post_init__(self) -> None:
        if self.bits not in (8, 12, 16):
            raise ValueError(f"bits = {self.bits}: must be 8, 12 or 16")


@dataclass(frozen=True)
class FilmChip(Chip):
    """What may be wrong with a film camera besides."""

    dropped: float = 0.0  # share of frames lost at random
    clock_offset: float = 0.0  # s, a frame stamped t shows t + clock_offset + clock_drift t
    clock_drift: float = 0.0


@dataclass(frozen=True)
class Camera(FilmChip):
    """Describe the camera of the rod film, by default the good one of the samples. Grey levels of 8 bits."""

    electrons_per_grey: float = 45.0
    read_noise: float = 0.8  # grey
    reflection: float = 0.0  # grey of highlights that move with the rod


@dataclass(frozen=True)
class GrainCamera(FilmChip):
    """Describe the camera of the grain film."""

    electrons_per_grey: float = 60.0
    read_noise: float = 1.0  # grey
    glare: float = 0.0  # grey of a reflection that stands still on the glass


@dataclass(frozen=True)
class BedCamera(Chip):
    """Describe the camera of the bed image."""

    electrons_per_grey: float = 40.0
    read_noise: float = 1.5  # grey
    glare: float = 0.0  # grey of a reflection that stands still on the glass


class Lens(NamedTuple):
    """Distortion: true offset from (row, column) = seen offset x (1 + k1 r^2 + k2 r^4), r the seen offset [px]."""

    k1: float
    k2: float
    row: float
    column: float


NO_LENS = Lens(0.0, 0.0, 0.0, 0.0)


@nb.njit(cache=True)
def true_place(row, column, lens):  # type: ignore[no-untyped-def]
    y, x = row - lens.row, column - lens.column
    r2 = x * x + y * y
    more = 1.0 + lens.k1 * r2 + lens.k2 * r2 * r2
    return lens.row + y * more, lens.column + x * more


@nb.njit(cache=True)
def seen_place(row, column, lens):  # type: ignore[no-untyped-def]
    """Inverse of `true_place`, by fixed-point steps; to 1e-9 px for distortions of some per cent."""
    y, x = row, column
    for _ in range(60):
        true_row, true_column = true_place(y, x, lens)
        y, x = y + row - true_row, x + column - true_column
    return y, x


def seen_places(rows: Array, column: float, lens: Lens) -> tuple[Array, Array]:
    """Rows and columns, each like `rows`, at which the lens shows points of an undistorted picture."""
    places = np.array([seen_place(r, column, lens) for r in np.ravel(rows)]).reshape(*np.shape(rows), 2)
    return places[..., 0], places[..., 1]


def lens_of(k1: float, k2: float, shape: tuple[int, int]) -> Lens:
    """The lens whose axis meets the middle of a picture of `shape` (rows, columns)."""
    return Lens(k1, k2, 0.5 * (shape[0] - 1), 0.5 * (shape[1] - 1))


def margin(shape: tuple[int, int], lens: Lens) -> int:
    """How many pixels a distorting lens sees beyond the borders of an undistorted picture of `shape`, and 6 more."""
    if lens.k1 == 0.0 and lens.k2 == 0.0:
        return 0
    row, column = true_place(0.0, 0.0, lens)
    return max(math.ceil(max(-row, -column)), 0) + 6


def distorted(wide: Array, lens: Lens, shape: tuple[int, int]) -> Array:
    """What the lens shows, of `shape`, of an undistorted picture with `margin` more pixels on every side.

    Cubic splines between pixels: a wave of 4 px is off by 2 % of its amplitude at most, one of 8 px by 0.1 %.
    """
    from scipy.ndimage import map_coordinates

    m = margin(shape, lens)
    if m == 0:
        return wide
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    y, x = y - lens.row, x - lens.column
    r2 = x * x + y * y
    more = 1.0 + lens.k1 * r2 + lens.k2 * r2 * r2
    places = [lens.row + y * more + m, lens.column + x * more + m]
    return np.asarray(map_coordinates(wide, places, order=3, mode="nearest"), dtype=np.float64)


def shade(shape: tuple[int, int], shading: float) -> Array:
    """Share of the light that reaches the pixels: 1 in the middle, 1 - shading in the corners."""
    down, across = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return np.asarray(1.0 - 0.5 * shading * (across**2 + down**2))


def reflection(shape: tuple[int, int], glare: float) -> Array:
    """A soft spot on the glass right of the middle, `glare` grey levels at its brightest."""
    down, across = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return np.asarray(glare * np.exp(-((across - 0.55) ** 2) / 0.08 - (down + 0.3) ** 2 / 0.15))


def record(
    mean: Array, *, electrons_per_grey: float, read_noise: float, rng: np.random.Generator, bits: int = 8
) -> NDArray[Any]:
    """Pixels of an image whose noise-free values are `mean` in 8-bit grey levels, any shape; uint8, or uint16 in steps
    of 2^(8 - bits) grey levels for deeper pixels.

    Variance below saturation: mean / electrons_per_grey + read_noise^2 + step^2/12 [grey^2] (photons, read-out,
    rounding).
    """
    electrons = rng.poisson(np.maximum(mean, 0.0) * electrons_per_grey)
    return digitised(electrons / electrons_per_grey + rng.normal(0.0, read_noise, mean.shape), bits)


def record_bright(
    mean: NDArray[Any], *, electrons_per_grey: float, read_noise: float, rng: np.random.Generator, bits: int = 8
) -> NDArray[Any]:
    """`record` with Gaussian photon noise, six times as quick: the same mean and variance; for some hundred electrons a
    pixel and more, where the skewness 1/sqrt(electrons) of the counts is below a tenth."""
    noise = rng.standard_normal(mean.shape, dtype=np.float32)
    bright = mean.astype(np.float32)
    noise *= np.sqrt(np.maximum(bright, 0.0) / np.float32(electrons_per_grey) + np.float32(read_noise**2))
    return digitised(bright + noise, bits)


def digitised(grey: NDArray[Any], bits: int) -> NDArray[Any]:
    """8-bit grey levels as pixels: uint8, or uint16 in steps of 2^(8 - bits) grey levels."""
    if bits == 8:
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)
    return np.clip(np.rint(grey * 2.0 ** (bits - 8)), 0, 2**bits - 1).astype(np.uint16)


def exposed(
    mean: NDArray[Any], camera: Camera | GrainCamera | BedCamera, rng: np.random.Generator, *, bright: bool = False
) -> NDArray[Any]:
    """Pixels of `record`, or of `record_bright`, by the chip of a camera."""
    see = record_bright if bright else record
    return see(
        mean,
        electrons_per_grey=camera.electrons_per_grey,
        read_noise=camera.read_noise,
        bits=camera.bits,
        rng=rng,
    )


def blur(image: Array, sigma: float) -> Array:
    """Gaussian blur of the last two axes by sigma [px], edges repeated."""
    reach = math.ceil(4 * sigma)
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    taps /= taps.sum()
    out = np.asarray(image, dtype=float)
    for axis in (-2, -1):
        pad = [(0, 0)] * out.ndim
        pad[axis] = (reach, reach)
        padded = np.pad(out, pad, mode="edge")
        n = out.shape[axis]
        out = sum(tap * np.take(padded, range(i, i + n), axis=axis) for i, tap in enumerate(taps))
    return out


def texture(shape: tuple[int, int], *, sigma: float, rng: np.random.Generator) -> Array:
    """Smooth random pattern of zero mean and unit spread, correlated over about sigma [px]."""
    field = blur(rng.normal(size=shape), sigma)
    return (field - field.mean()) / field.std()
