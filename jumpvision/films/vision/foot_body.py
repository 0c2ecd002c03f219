"""The foot in frame 0, and where it is in another frame: by its texture and by its edge.

Lamp and glare stay where they are while the body moves under them: what a straight line in each column explains of the
difference of two pictures is taken off before they are compared, so neither moves the result.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import FROM_MAD, Array
from jumpvision.films.calibration import FACE_READ

BELOW = 3  # rows under the face that take part in the fit of the edge
BLURS = (0.3, 0.5, 0.7, 0.9, 1.2, 1.6)  # px, widths tried for the edge in frame 0
SMOOTH = 1.0  # px, standard deviation of the Gaussian that both pictures of the body are smoothed with
BLOCK = 16  # columns that share a grain: the errors of blocks are independent, those of columns are not
CLIP = 9.0  # squared residual, in variances, above which a pixel of the body says no more than that it is hidden
MAX_SIGMA = 0.5  # px, a worse face is no face
LEAST_ROWS = 5  # of the body to be compared


class Found(NamedTuple):
    """row, sigma [px] of the face, "" or why there is none; by_texture: the texture says more of it than the edge."""

    row: float
    sigma: float
    flag: str
    by_texture: bool


class Body:
    """The foot in frame 0: its columns, its picture, its noise, the blur of its edge."""

    def __init__(self, image: NDArray[np.generic], row: float, column: float, half_width: float, depth: int):
        height, width = image.shape
        left, right = math.ceil(column - half_width + 2), math.floor(column + half_width - 2)
        left, right = max(left, 0), min(right, width - 1)
        if right - left + 1 < 2 * BLOCK:
            raise ValueError(
                f"half_width = {half_width} px about column = {column}: the body must have {2 * BLOCK} columns or more"
            )
        if not depth >= 6 or row - depth < 0 or row > height - 2 - BELOW:
            raise ValueError(
                f"row = {row}, depth = {depth} px: at least 6 rows of the body above the face and {BELOW + 1} rows "
                f"below it must lie in the image of {height} rows"
            )
        self.columns = slice(left, right + 1)
        self.depth = depth
        first = np.asarray(image[:, self.columns], np.float64)
        # first with the body cut off well above the guessed face, then just above the face that was found
        self.row, self.blur, self.offset_sigma = row, BLURS[-1], 0.0
        for cut in (4.5, None):
            found = []
            self._picture(first, cut)
            start = self._coarse(first, self.row, 3.0)
            for self.blur in BLURS:
                f, sigma, misfit = self._edge(first, start)
                if sigma < MAX_SIGMA and abs(f - row) <= 3.0:
                    found.append((misfit, f, self.blur, sigma))
            if (
                not found
            ):  # a foot above its hole, dark on dark: its place is the one given, its motion is in its texture
                self.row, self.blur, self.offset_sigma = row, BLURS[-1], FACE_READ.value
                break
            _, self.row, self.blur, self.offset_sigma = min(found)
        self._picture(first, None)

    def _picture(self, image: Array, cut: float | None) -> None:
        """Spline of the body above the face; nearer to it than the blur reaches, its last clean row goes on."""
        self.top = max(0, math.floor(self.row) - self.depth - 2)
        clean = math.floor(self.row - (cut or max(2.5 * self.blur, 1.0)))
        self.rows = np.arange(self.top, math.ceil(self.row) + 40)
        t = image[np.minimum(self.rows, clean)]
        self.spline = scipy.ndimage.spline_filter1d(
            scipy.ndimage.gaussian_filter(t, SMOOTH), order=3, axis=0, mode="nearest"
        )
        inside = t[: clean - self.top + 1]
        # the face is known to 3 px: the last rows of the body in frame 0 are not searched for
        keep = slice(0, max(len(inside) - 3, 0))
        self.first, self.texture = self.top, scipy.ndimage.gaussian_filter(inside, SMOOTH)[keep]
        # noise from second differences along the columns, robust against the texture of the body
        self.noise = max(FROM_MAD * float(np.median(np.abs(np.diff(inside, 2, axis=0)))) / math.sqrt(6), 0.5)

    def template(self, y: Array, f: float) -> Array:
        """The body with its face at f, on the rows y: (len(y), columns)."""
        j = np.clip(y - (f - self.row) - self.top, 0, len(self.rows) - 1)
        grid = np.broadcast_to(j[:, None], (len(y), self.spline.shape[1]))
        i = np.broadcast_to(np.arange(self.spline.shape[1]), grid.shape)
        return scipy.ndimage.map_coordinates(self.spline, [grid, i], order=3, prefilter=False, mode="nearest")

    def find(self, image: NDArray[np.generic], guess: float, reach: float) -> Found:
        """Face in another frame, within `reach` of `guess` [px]."""
        strip = np.asarray(image[:, self.columns], np.float64)
        if not np.isfinite(strip).all():
            return Found(math.nan, math.nan, "pixels without value on the foot", False)
        smooth = scipy.ndimage.gaussian_filter(strip, SMOOTH)
        f, sigma = self._texture(smooth, self._matched(smooth, guess, reach))
        if sigma < MAX_SIGMA:
            return Found(f, sigma, "", True)
        start = self._coarse(strip, guess, reach)
        if not math.isfinite(start):
            return Found(math.nan, math.nan, "foot out of the image", False)
        f, sigma, _ = self._edge(strip, start)
        if not math.isfinite(f) or abs(f - start) > 2.5:
            f, sigma = start, math.inf
        by_texture, texture_sigma = self._texture(smooth, f)
        if math.isfinite(texture_sigma):
            share = sigma**2 / (sigma**2 + texture_sigma**2) if math.isfinite(sigma) else 1.0
            f, sigma = f + share * (by_texture - f), math.sqrt(share) * texture_sigma
        if not sigma < MAX_SIGMA:
            return Found(math.nan, math.nan, "neither edge nor texture to hold on to", False)
        if self._hidden(strip, f) > 0.5:
            return Found(math.nan, math.nan, "body does not match frame 0", False)
        return Found(f, sigma, "", False)

    def _matched(self, smooth: Array, guess: float, reach: float) -> float:
        """Face where the body's texture is again, to half a row; NaN where it is nowhere or in two places.

        Greatest correlation coefficient over whole rows; a wrong match of a rigid body shows as a second place that is
        nearly as good.
        """
        shifts = list(range(math.floor(guess - reach - self.row), math.ceil(guess + reach - self.row) + 1))
        score = np.full(len(shifts), -1.0)
        for k, n in enumerate(shifts):
            top, bottom = max(self.first + n, 0), min(self.first + n + len(self.texture), len(smooth))
            if bottom - top < LEAST_ROWS:
                continue
            a = straightened(smooth[top:bottom])
            b = straightened(self.texture[top - n - self.first : bottom - n - self.first])
            score[k] = float((a * b).sum()) / math.sqrt(max(float((a * a).sum() * (b * b).sum()), 1e-12))
        best = int(np.argmax(score))
        # one match has high coefficients within 4 rows
        others = score[np.abs(np.arange(len(shifts)) - best) > 4]
        # below a half a texture is not that of frame 0;
        # and it must lead over those farther off
        if score[best] < 0.5 or (others.size and float(others.max()) > score[best] - 0.15):
            return math.nan
        return self.row + float(shifts[best])

    def _variance(self) -> float:
        return 2 * self.noise**2 + 1.0  # noise of both frames, and one grey level for the rounding and the lamp

    def _residual(self, strip: Array, y: NDArray[np.integer], f: float) -> Array:
        r = strip[y] - self.template(y.astype(np.float64), f)
        return r - np.median(r)  # the lamp may change

    def _hidden(self, strip: Array, f: float) -> float:
        """Share of the body's pixels that do not look as in frame 0."""
        y = np.arange(max(0, math.ceil(f) - self.depth), max(1, math.floor(f - 2.5 * self.blur)))
        return float(np.mean(self._residual(strip, y, f) ** 2 > CLIP * self._variance()))

    def _coarse(self, strip: Array, guess: float, reach: float) -> float:
        """Best face on whole and half rows: the rows above explained by the body, those below by any other grey."""
        height = len(strip)
        lowest, highest = max(guess - reach, 6.0), min(guess + reach, height - 2.0 - BELOW)
        if lowest > highest:
            return math.nan
        candidates = np.arange(lowest, highest + 0.25, 0.5)
        top = max(0, math.ceil(lowest) - self.depth)
        y = np.arange(top, min(height, math.ceil(highest) + BELOW))
        # what the grains look like: the rows under the last candidate, or as far as the picture goes
        under = strip[min(math.ceil(highest), height - 4) :][: 4 * BLOCK]
        level, spread = float(under.mean()), max(float(under.std()), 3.0)
        variance = self._variance()
        grains = np.minimum(((strip[y] - level) / spread) ** 2, CLIP) + math.log(spread**2 / variance)
        best = score = math.inf
        for f in candidates:
            n = int(np.searchsorted(y, f))
            body = np.minimum(self._residual(strip, y[:n], f) ** 2 / variance, CLIP) if n else np.zeros((0, 1))
            total = float(body.sum() + grains[n:].sum())
            if total < score:
                best, score = float(f), total
        return best

    def _texture(self, smooth: Array, f: float) -> tuple[float, float]:
        """Face from the body's texture alone, near f, and its standard uncertainty; infinite without texture.

        Gauss-Newton with the gradient of the mean of both pictures and the information sum T' I', so that noise is
        not taken for texture.
        """
        sigma, start = math.inf, f
        if not math.isfinite(f):
            return f, sigma
        for _ in range(12):
            clear = max(2.5 * self.blur, 1.0) + 2.5 * SMOOTH + 1  # what the grains reach by blur and smoothing
            y = np.arange(max(2, math.ceil(start) - self.depth), math.floor(start - clear))
            if len(y) < LEAST_ROWS:
                return f, math.inf
            t = self.template(np.arange(y[0] - 1.0, y[-1] + 2), f)
            i = smooth[y[0] - 1 : y[-1] + 2]
            slope_t, slope_i = (straightened(0.5 * (a[2:] - a[:-2])) for a in (t, i))
            r = straightened(i[1:-1] - t[1:-1])
            keep = r * r < CLIP * max(self._variance(), 2 * float(np.median(r * r)))
            j = -0.5 * (slope_t + slope_i) * keep
            products = slope_t * slope_i * keep
            hessian = float(products.sum())
            # 4 standard deviations of what noise alone makes of the sum: the variance of a smoothed slope is
            # noise^2 / (8 pi SMOOTH^4), and 4 pi SMOOTH^2 pixels share one value
            noise = max(0.5 * float(np.mean((slope_t - slope_i) ** 2)), self.noise**2 / (8 * math.pi * SMOOTH**4))
            if hessian < 4 * noise * SMOOTH * math.sqrt(4 * math.pi * products.size):
                return start, math.inf
            step = float((j * r).sum()) / hessian
            f += min(max(step, -1.0), 1.0)
            parts = _blocks(j * (r - step * j))
            sigma = math.sqrt(float((parts**2).sum()) * len(parts) / (len(parts) - 1)) / hessian
            if abs(step) < 0.002:
                break
        return (f, sigma) if abs(f - start) < 2.5 else (start, math.inf)

    def _glare(self, strip: Array, f: float) -> Array:
        """By how much each column above the edge is brighter than in frame 0, (columns,)."""
        y = np.arange(max(0, math.ceil(f) - self.depth), math.floor(f - max(2.5 * self.blur, 1.0)) - 1)
        if len(y) < LEAST_ROWS:
            return np.zeros(strip.shape[1])
        more = np.median(strip[y] - self.template(y.astype(np.float64), f), axis=0)
        return np.asarray(scipy.ndimage.gaussian_filter1d(more, 0.5 * BLOCK))

    def _edge(self, strip: Array, f: float) -> tuple[float, float, float]:
        """Gauss-Newton for the face with the grey of the grains eliminated in each column.

        Returns the face, its standard uncertainty from the scatter of blocks of columns, and the mean squared residual
        at the edge [grey^2].
        """
        height = len(strip)
        sigma = misfit = math.inf
        for _ in range(20):
            reach = max(2.5 * self.blur, 1.0) + 0.5
            y = np.arange(math.ceil(f - reach), min(height, math.floor(f) + BELOW + 1))
            if y[0] < 0 or y[-1] < f + 1:
                return math.nan, math.inf, math.inf
            z = ((y - f) / self.blur)[:, None]
            phi = scipy.special.ndtr(z)
            t = self.template(y.astype(np.float64), f) + self._glare(strip, f)
            rest = strip[y] - t * (1 - phi)
            grey = (rest * phi).sum(0) / (phi * phi).sum(0)
            r = rest - grey * phi
            j = (t - grey) * np.exp(-0.5 * z * z) / (math.sqrt(2 * math.pi) * self.blur)  # dI/df
            j = j - phi * (j * phi).sum(0) / (phi * phi).sum(0)
            misfit = float(np.mean(r**2))
            hessian = float((j * j).sum())
            if hessian <= 0:
                return math.nan, math.inf, math.inf
            step = float((j * r).sum()) / hessian
            f += min(max(step, -1.0), 1.0)
            parts = _blocks(j * (r - step * j))
            sigma = math.sqrt(float((parts**2).sum()) * len(parts) / (len(parts) - 1)) / hessian
            if abs(step) < 0.002:
                break
        return f, sigma, misfit


def straightened(f: Array) -> Array:
    """f (rows, columns) less a straight line along the rows in each column."""
    y = np.arange(len(f)) - 0.5 * (len(f) - 1)
    return f - f.mean(0) - y[:, None] * ((y @ f) / float(y @ y))


def _blocks(f: Array) -> Array:
    """Sums over blocks of columns of a strip (rows, columns)."""
    n = f.shape[1] // BLOCK * BLOCK
    return f[:, :n].reshape(len(f), -1, BLOCK).sum((0, 2))
