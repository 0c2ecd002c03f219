"""The last fit of a ball of any face: its picture, size, blur and exposure, and every frame's place, all at once.

    I_i = S (1 - a_i) + light_i a_i + contrast_i m_i,    a = share of a disc, m = that disc's face, blurred alike,

laid at (x, y), turned, and smeared by the exposure's part of the way to the next frame. The face is a sum of cosine
waves w_j cos(j pi u / side) cos(k pi v / side). Gauss-Newton on all frames' own pixels, the frames' five unknowns
eliminated first, as in a bundle adjustment (Triggs et al. 2000); the variance of the waves and the scatter of light and
contrast are the film's own (empirical Bayes). What the shared unknowns cost a position stands in its sigma.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk

from jumpvision.base.arrays import FROM_MAD, Array, Float32, Image
from jumpvision.base.threads import at_once
from jumpvision.films.calibration import OUTLINE_RADIUS
from jumpvision.films.frames.base import Frames
from jumpvision.films.vision.ball.measure import Found
from jumpvision.films.vision.ball.reasons import GOOD, Flag, Reason

from .layer import ODD, Layer, Place, shifted
from .laying import FINE, FREE, lay

OVER = 2  # points of the disc that a picture is blurred from, to one of the picture
ROOM = 2.5  # px beyond the rim, that are fitted
BLUR = 0.76, 0.35  # px: of a rim, first and least
TURNS, REST, FIRST = 15, 0.2, 4  # of the fit; standard deviations of a place: the last; before which none is the last
LARGEST = 0.3  # step of radius, blur [px] and exposure
H = 0.02  # px: of differences by the radius and the blur
STALE = 0.03  # px of radius and blur, from which each wave's picture is made anew


@dataclass(frozen=True)
class _Shared:
    """waves: of the face; radius, blur [px]; exposure: share of the time between frames."""

    waves: Array
    radius: float
    blur: float
    exposure: float


@dataclass(frozen=True)
class _Frame:
    """A frame's pixels about its ball: grey and scene, where (x right, y down); velocity of the ball [px a frame]."""

    grey: Array
    behind: Array
    u: Array
    v: Array
    velocity: tuple[float, float]


class _Face:
    """Pictures of a disc with each wave of a face, blurred; FINE points to a pixel, the centre in the middle."""

    def __init__(self, radius: float):
        self.side = 2.0 * (radius + 1.0)
        self.k = 2 * math.ceil(FINE * (radius + ROOM + 3 * BLUR[0])) + 1
        n = 1 + round(self.side / 1.25)  # px: the shortest half wave of a face
        jj, kk = (a.ravel() for a in np.indices((n, n)))
        inside = np.hypot(jj, kk) < n
        self.j, self.k_wave = jj[inside], kk[inside]
        number = math.pi * np.hypot(self.j, self.k_wave) * radius / self.side
        # the amplitude of a face's waves falls with the square of the wave number
        self.falls = 1.0 / (1.0 + number**2)
        m = OVER * self.k
        at = (np.arange(m) - 0.5 * (m - 1)) / (FINE * OVER)
        self.r = np.hypot(*np.meshgrid(at, at))
        phase = math.pi * (np.clip(at / self.side, -0.5, 0.5) + 0.5)
        self.cosine = np.cos(np.arange(n)[:, None] * phase).astype(np.float32)

    def _blurred(self, sharp: Image, blur: float) -> Float32:
        soft = cv2.GaussianBlur(sharp, (0, 0), blur * FINE * OVER)
        return np.asarray(cv2.resize(soft, (self.k, self.k), interpolation=cv2.INTER_AREA))

    def _disc(self, radius: float) -> Float32:
        return np.clip((radius - self.r) * FINE * OVER + 0.5, 0.0, 1.0).astype(np.float32)

    def stack(self, s: _Shared) -> Float32:
        """(waves, k k): the first is the disc's share."""
        disc = self._disc(s.radius)

        def wave(j: int, k: int) -> Float32:
            return self._blurred(disc * np.outer(self.cosine[k], self.cosine[j]), s.blur).ravel()

        return np.stack(at_once([partial(wave, j, k) for j, k in zip(self.j, self.k_wave, strict=True)]))

    def pair(self, s: _Shared, radius: float, blur: float) -> NDArray[np.float64]:
        """(2, k k): share and face for another radius and blur."""
        disc = self._disc(radius)
        grid = np.zeros((self.cosine.shape[0],) * 2, np.float32)
        grid[self.k_wave, self.j] = s.waves
        face = self.cosine.T @ grid @ self.cosine
        return np.stack([self._blurred(p, blur).ravel() for p in (disc, disc * face)]).astype(np.float64)


class _Pictures:
    """What is laid in a frame: the stack (k k, waves), of a radius and blur (`of`) that may be STALE; laid (k k, 12):
    share and face, then their derivatives."""

    def __init__(self, face: _Face, s: _Shared, before: _Pictures | None = None):
        value = face.pair(s, s.radius, s.blur)
        self.of, self.stack = (s.radius, s.blur), np.zeros((0, 0), np.float32)
        if before is not None and max(abs(a - b) for a, b in zip(self.of, before.of, strict=True)) < STALE:
            self.stack, self.of = before.stack, before.of
        else:
            self.stack = np.ascontiguousarray(face.stack(s).T)
        square = value.reshape(2, face.k, face.k)
        by_u, by_v = (_slope(square, axis).reshape(2, -1) for axis in (2, 1))
        v, u = ((a - (face.k - 1) / 2).ravel() / FINE for a in np.indices((face.k, face.k)))
        by_turn = by_u * v - by_v * u
        by_radius, by_blur = (
            (face.pair(s, s.radius + a, s.blur + b) - face.pair(s, s.radius - a, s.blur - b)) / (2 * H)
            for a, b in ((H, 0.0), (0.0, H))
        )
        self.laid = np.ascontiguousarray(np.concatenate([value, by_u, by_v, by_turn, by_radius, by_blur]).T)


def _slope(square: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Derivative by a pixel, of fourth order."""
    a, b, c, d = (np.roll(square, s, axis) for s in (2, 1, -1, -2))
    return np.asarray((a - 8.0 * b + 8.0 * c - d) * FINE / 12.0)


class _Equations:
    """Normal equations of one frame, weighted: h (5, 5) of its own unknowns, c (shared, 5), n (shared, shared) of the
    shared ones (waves, radius, blur, exposure), g and b their right sides; noise [grey]. alone: no shared ones."""

    def __init__(self, f: _Frame, p: Place, s: _Shared, pictures: _Pictures, prior: Array, alone: bool = False):
        out, waves = np.empty((f.u.size, 16)), np.empty((f.u.size, 0 if alone else s.waves.size), np.float32)
        stack = pictures.stack[:, :0] if alone else pictures.stack
        place = np.array([p.x, p.y, p.turn])
        lay(f.u, f.v, place, s.exposure, np.array(f.velocity), pictures.laid, stack, out, waves)
        a, m, a_u, m_u, a_v, m_v, a_t, m_t, a_r, m_r, a_b, m_b, *along = out.T
        cos, sin = math.cos(p.turn), math.sin(p.turn)
        bright = p.light - f.behind

        def change(share: Array, face: Array) -> Array:
            return bright * share + p.contrast * face

        by_u, by_v = change(a_u, m_u), change(a_v, m_v)
        x, y = -(cos * by_u - sin * by_v), -(sin * by_u + cos * by_v)
        e_u, e_v = change(*along[:2]), change(*along[2:])
        vx, vy = f.velocity
        exposure = -vx * (cos * e_u - sin * e_v) - vy * (sin * e_u + cos * e_v)
        own = np.stack([x, y, change(a_t, m_t), a, m], axis=1)
        shared = np.zeros((f.u.size, 0))
        if not alone:
            shared = np.column_stack(
                [p.contrast * waves.astype(np.float64), change(a_r, m_r), change(a_b, m_b), exposure]
            )
        left = f.grey - f.behind - change(a, m)
        self.noise = max(FROM_MAD * float(np.median(np.abs(left))), 1e-6 * float(np.ptp(f.grey)) + 1e-9)
        # a pixel that is off by 3 standard deviations counts less
        weight = np.minimum(1.0, 3.0 * self.noise / np.maximum(np.abs(left), 1e-12))
        # a pixel with less than 0.03 of the ball shows the scene:
        # what differs from it by more than 4 standard deviations is something else
        strange = (a < 0.03) & (np.abs(left) > 4.0 * self.noise)  # a shadow, a hand
        if strange.any():
            off = np.hypot(f.u[:, None] - f.u[strange], f.v[:, None] - f.v[strange])
            weight[off.min(axis=1) < 2.0] = 0.0  # px about it are left out
        self.count, self.power = float(weight.sum()), float(weight @ left**2)
        ball = a > 0.5
        self.off = float(np.mean(left[ball] ** 2)) if ball.any() else math.inf
        self.unlike = float(np.sum(left[ball] ** 2) / max(np.sum((f.grey - f.behind)[ball] ** 2), 1e-9))
        self.longest = np.array([1.0, 1.0, 0.3, np.inf, 0.3])
        root = np.sqrt(weight) / self.noise
        own, shared, left = own * root[:, None], shared * root[:, None], left * root
        self.h, self.c = own.T @ own, shared.T @ own
        # half of the products; the other half is the same
        half = np.empty((0, 0)) if alone else dsyrk(1.0, shared.T)
        self.n = half + np.triu(half, 1).T
        self.g, self.b = own.T @ left, shared.T @ left
        self.h[np.diag_indices(5)] += prior
        self.g -= prior * np.array([0.0, 0.0, 0.0, p.light, p.contrast - 1.0])


@dataclass
class _Film:
    """What is sought: the shared unknowns, every good frame's place; variance of a wave of number 0 [grey^2], and of
    light and contrast from frame to frame. rim: the radius as the outline has it, and its variance [px^2]."""

    rim: tuple[float, float]
    shared: _Shared
    places: dict[int, Place]
    variance: float
    spread: Array

    @property
    def prior(self) -> Array:
        """Of a frame's own unknowns, one over the variance."""
        return np.concatenate([[0.0, 0.0, 1e-6], 1.0 / self.spread])  # 1 / rad^2: the turn is nearly free


class Adjusted(NamedTuple):
    """places: one a frame; centre: standard uncertainty of the ball's centre in its picture [px], which the places
    share and their sigmas have not; misfit: noise at the ball over that of the scene."""

    places: list[Place]
    centre: float
    misfit: float


def adjusted(
    frames: Frames, scene: Float32, places: list[Place], layer: Layer, outlined: bool, n: int
) -> Adjusted | None:
    """The places [one a frame] of a learned layer, all fitted at once, what they share by the first n frames.

    None where the fit does not come to rest. outlined: the layer's diameter is of an outline, not only about right.
    """
    if layer.d > 40.0:  # a larger ball would have more than some hundred waves
        return None
    good = [i for i, p in enumerate(places[:n]) if not p.found.flag]
    teach = good[:: max(1, math.ceil(len(good) / 40))]
    cuts = {i: _cut(np.asarray(frames[i]), scene, places, i, layer.d) for i in teach}
    face = _Face(0.5 * layer.d)
    shown = layer.shown[layer.alpha > 0.5]
    height = float(np.std(shown)) + abs(float(np.median(shown)))
    widest = np.array([(FREE * height) ** 2, FREE**2])
    shared = _Shared(np.zeros(face.falls.size), 0.5 * layer.d, BLUR[0], 0.0)
    film = _Film(
        (0.5 * layer.d, OUTLINE_RADIUS.value[not outlined] ** 2),
        shared,
        {i: places[i] for i in teach},
        height**2,
        widest,
    )
    pictures: _Pictures | None = None
    for turn in range(TURNS):
        pictures = _Pictures(face, film.shared, pictures)
        equations = _all_equations(film, cuts, teach, pictures)
        if turn in (FIRST // 2, FIRST):
            usual_off = _usual(equations, film.places)
            odd = [i for i, e in equations.items() if _times_off(e, film.places[i], usual_off, widest) is not None]
            teach = [i for i in teach if i not in odd]
            equations = {i: equations[i] for i in teach}
        if len(teach) < 4:  # too few to tell what they share
            return None
        cov, moved = _stepped(film, face, equations, widest, turn)
        # the fitted diameter may differ from the learned one by so much
        if not abs(2.0 * film.shared.radius / layer.d - 1.0) < 0.4:
            return None
        if turn > FIRST and moved < REST:
            break
    else:
        if moved > 1.0:
            return None
    usual = _centred(places, film.places, teach)
    apart = [float(np.median(cv2.absdiff(np.asarray(frames[i], np.float32)[::4, ::4], scene[::4, ::4]))) for i in teach]
    at_ball = float(np.median([e.noise for e in equations.values()]))
    measured = _Measured(film, _Pictures(face, film.shared), {i: cuts[i] for i in teach}, cov, widest)
    out = []
    for i, p in enumerate(places):
        if not p.found.flag:
            p = measured.one(i, _cut(np.asarray(frames[i]), scene, places, i, layer.d), _moved(p, *usual))
        out.append(p)
    return Adjusted(out, measured.centre(), at_ball / max(FROM_MAD * float(np.median(apart)), 1e-9))


def _all_equations(
    film: _Film, cuts: dict[int, _Frame], which: list[int], pictures: _Pictures
) -> dict[int, _Equations]:
    """Those of so many frames, with the shared unknowns."""
    calls = [partial(_Equations, cuts[i], film.places[i], film.shared, pictures, film.prior) for i in which]
    return dict(zip(which, at_once(calls), strict=True))


def _usual(equations: dict[int, _Equations], places: dict[int, Place]) -> tuple[float, Array]:
    """What most frames leave of the picture [grey^2], and their light and contrast."""
    off = float(np.median([e.off for e in equations.values()]))
    return off, np.median([[places[i].light, places[i].contrast] for i in equations], axis=0)


def _times_off(e: _Equations, p: Place, usual: tuple[float, Array], widest: Array) -> float | None:
    """By how many times as much as most frames one is off the picture, where its ball is not that of the others: it is
    another thing that has been made alike by another light. None where it is that ball."""
    times = math.sqrt(e.off / max(usual[0], 1e-12))
    # light or contrast beyond 3 times the widest is not the ball's
    far = bool((np.abs(np.array([p.light, p.contrast]) - usual[1]) > 3.0 * np.sqrt(widest)).any())
    return times if far or times > ODD else None


def _stepped(
    film: _Film, face: _Face, equations: dict[int, _Equations], widest: Array, turn: int
) -> tuple[Array, float]:
    """One step of all unknowns, in place; the covariance of the shared ones, and the largest step of a frame in units
    of its own standard deviation. The first is of the face alone, the exposure joins in the third."""
    s, w = film.shared, face.falls.size
    number = 1.0 / (film.variance * face.falls**2)
    normal = np.sum([e.n for e in equations.values()], axis=0)
    right = np.sum([e.b for e in equations.values()], axis=0)
    if turn:
        back = {i: np.linalg.solve(e.h, np.column_stack([e.c.T, e.g])) for i, e in equations.items()}
        normal -= np.sum([equations[i].c @ b[:, :-1] for i, b in back.items()], axis=0)
        right -= np.sum([equations[i].c @ b[:, -1] for i, b in back.items()], axis=0)
    normal[np.arange(w), np.arange(w)] += number
    right[:w] -= number * s.waves
    normal[w, w] += 1.0 / film.rim[1]
    right[w] -= (s.radius - film.rim[0]) / film.rim[1]
    free = np.arange(w + 3) < (w, w + 2, w + 3)[min(turn, 2)]
    cov = np.zeros_like(normal)
    cov[np.ix_(free, free)] = np.linalg.inv(normal[np.ix_(free, free)] + 1e-9 * np.eye(free.sum()))
    step = cov @ right
    radius, blur, exposure = np.clip(step[w:], -LARGEST, LARGEST)
    if turn == 1:  # its derivative is none at none
        exposure = 0.05  # to begin with
    film.shared = _Shared(
        s.waves + step[:w],
        s.radius + radius,
        max(s.blur + blur, BLUR[1]),
        float(np.clip(s.exposure + exposure, 0.0, 1.0)),
    )
    determined = float(np.sum(1.0 - number * np.diag(cov)[:w]))  # waves that the film tells (MacKay 1992)
    film.variance = float(np.sum(number * film.shared.waves**2) * film.variance / max(determined, 1.0))
    moved = 0.0
    if turn:
        for i, e in equations.items():
            film.places[i], far = _placed(film.places[i], back[i][:, -1] - back[i][:, :-1] @ step, e)
            moved = max(moved, far)
        own = np.mean([np.diag(np.linalg.inv(e.h))[3:] for e in equations.values()], axis=0)
        values = np.var([[film.places[i].light, film.places[i].contrast] for i in equations], axis=0)
        film.spread = np.clip(values + own, 1e-6 * widest, widest)
    return cov, moved if turn else math.inf


def _placed(p: Place, step: Array, e: _Equations) -> tuple[Place, float]:
    """The place a step on, and how far that is in its own standard deviations."""
    du, dv, turn, light, contrast = (float(v) for v in np.clip(step, -e.longest, e.longest))
    far = math.sqrt(max(float(step[:2] @ e.h[:2, :2] @ step[:2]), 0.0))
    return replace(
        p, x=p.x + du, y=p.y + dv, turn=p.turn + turn, light=p.light + light, contrast=p.contrast + contrast
    ), far


class _Measured:
    """Frames fitted one by one with the shared unknowns as they are; sigma: a frame's own, and what the shared ones
    cost a frame that taught them beyond what they cost all alike."""

    def __init__(self, film: _Film, pictures: _Pictures, cuts: dict[int, _Frame], cov: Array, widest: Array):
        self.film, self.pictures, self.widest = film, pictures, widest
        self.taught = {i: self._at_rest(cut, film.places[i]) for i, cut in cuts.items()}
        last = _all_equations(
            replace(film, places={i: p for i, (p, _) in self.taught.items()}), cuts, [*cuts], pictures
        )
        self._costs = {i: np.linalg.solve(e.h, e.c.T)[:2] for i, e in last.items()}
        mean = np.mean(list(self._costs.values()), axis=0)
        self._shares = {i: (c - mean) @ cov @ (c - mean).T for i, c in self._costs.items()}
        self._usual_share = np.mean(list(self._shares.values()), axis=0)
        self._cov = cov
        self._usual = _usual({i: e for i, (_, e) in self.taught.items()}, {i: p for i, (p, _) in self.taught.items()})

    def _at_rest(self, cut: _Frame, p: Place) -> tuple[Place, _Equations]:
        for _ in range(12):  # the shared unknowns stay as they are
            e = _Equations(cut, p, self.film.shared, self.pictures, self.film.prior, alone=True)
            p, far = _placed(p, np.asarray(np.linalg.solve(e.h, e.g), np.float64), e)
            if far < REST:
                break
        return p, _Equations(cut, p, self.film.shared, self.pictures, self.film.prior, alone=True)

    def one(self, i: int, cut: _Frame, start: Place) -> Place:
        """Frame i, whose place is about `start`."""
        p, e = self.taught.get(i) or self._at_rest(cut, start)
        var = np.linalg.inv(e.h)[:2, :2] * e.power / e.noise**2 / max(e.count - 5.0, 1.0)
        var = var + np.asarray(self._shares.get(i, self._usual_share))
        # a place may move by half of the radius
        if math.hypot(p.x - start.x, p.y - start.y) > 0.5 * self.film.shared.radius:
            return replace(p, found=Found(Flag(Reason.NOT_CONVERGED)))
        times = _times_off(e, p, self._usual, self.widest)
        if times is not None:
            return replace(p, found=Found(Flag(Reason.UNLIKE_OTHERS, (times,))))
        sigma = math.sqrt(max(var[0, 0], var[1, 1]))
        return replace(p, found=Found(GOOD, p.x, p.y, sigma, 2.0 * self.film.shared.radius, e.unlike))

    def centre(self) -> float:
        """Standard uncertainty of the centre in the ball's picture [px]."""
        turned = [_turned(self.taught[i][0].turn) @ c for i, c in self._costs.items()]
        centre = np.mean(turned, axis=0)
        return math.sqrt(float(np.max(np.diag(centre @ self._cov @ centre.T))))


def _centred(before: list[Place], after: dict[int, Place], teach: list[int]) -> tuple[float, float, float]:
    """By how much in the ball's picture (u, v) [px], and turned [rad], the fit has moved those that taught."""
    moves = [_turned(before[i].turn) @ [after[i].x - before[i].x, after[i].y - before[i].y] for i in teach]
    u, v = np.median(moves, axis=0)
    return float(u), float(v), float(np.median([after[i].turn - before[i].turn for i in teach]))


def _moved(p: Place, u: float, v: float, turn: float) -> Place:
    """A place before the fit, moved alike."""
    p = shifted(p, u, v)
    return replace(p, turn=p.turn + turn, light=0.0, contrast=1.0)


def _turned(turn: float) -> Array:
    """Matrix that turns (x, y) back into a ball's own picture."""
    c, s = math.cos(turn), math.sin(turn)
    return np.array([[c, s], [-s, c]])


def _cut(image: Image, scene: Float32, places: list[Place], i: int, d: float) -> _Frame:
    """The pixels of frame i about its place."""
    p, (h, w), reach = places[i], image.shape, 0.5 * d + ROOM
    rows, columns = (np.arange(max(0, int(a - reach)), min(n, int(a + reach) + 2)) for a, n in ((p.y, h), (p.x, w)))
    v, u = np.meshgrid(rows, columns, indexing="ij")
    near = np.hypot(u - p.x, v - p.y) < reach
    v, u = v[near], u[near]
    about = [j for j in (i - 1, i, i + 1) if 0 <= j < len(places) and not places[j].found.flag]
    a, b = places[about[0]], places[about[-1]]
    n = max(about[-1] - about[0], 1)
    grey, behind = image[v, u].astype(np.float64), scene[v, u].astype(np.float64)
    return _Frame(grey, behind, u.astype(np.float64), v.astype(np.float64), ((b.x - a.x) / n, (b.y - a.y) / n))
