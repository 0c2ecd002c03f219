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
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from jumpvision.base.arrays import FROM_MAD, Array, Float32, Image
from jumpvision.films.calibration import OUTLINE_RADIUS
from jumpvision.films.frames.base import Frames
from jumpvision.films.vision.ball.measure import Found
from jumpvision.films.vision.ball.reasons import GOOD, Flag, Reason

from .layer import Layer, Place, shifted

FINE, OVER = 3, 2  # points of the picture to a pixel; of the disc that it is blurred from, to one of these
ROOM = 2.5  # px beyond the rim, that are fitted
BLUR = 0.76, 0.35  # px: of a rim, first and least
TURNS, REST, FIRST = 15, 0.2, 4  # of the fit; standard deviations of a place: the last; before which none is the last
LARGEST = 0.3  # step of radius, blur [px] and exposure
FREE = 0.1  # of the contrast, by which light and contrast may change from frame to frame, at first
H = 0.02  # px: of differences by the radius and the blur


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
        pictures = (disc * np.outer(self.cosine[k], self.cosine[j]) for j, k in zip(self.j, self.k_wave, strict=True))
        return np.stack([self._blurred(p, s.blur).ravel() for p in pictures])

    def pair(self, s: _Shared, radius: float, blur: float) -> NDArray[np.float64]:
        """(2, k k): share and face for another radius and blur."""
        disc = self._disc(radius)
        grid = np.zeros((self.cosine.shape[0],) * 2, np.float32)
        grid[self.k_wave, self.j] = s.waves
        face = self.cosine.T @ grid @ self.cosine
        return np.stack([self._blurred(p, blur).ravel() for p in (disc, disc * face)]).astype(np.float64)


class _Pictures:
    """What is laid in a frame: the stack (k k, waves); share, face and their derivatives, each (2, k k)."""

    def __init__(self, face: _Face, s: _Shared):
        self.k = face.k
        stack = face.stack(s)
        self.value = np.stack([stack[0], s.waves @ stack]).astype(np.float64)
        self.stack = np.ascontiguousarray(stack.T)
        square = self.value.reshape(2, face.k, face.k)
        self.by_u, self.by_v = (_slope(square, axis).reshape(2, -1) for axis in (2, 1))
        v, u = ((a - (face.k - 1) / 2).ravel() / FINE for a in np.indices((face.k, face.k)))
        self.by_turn = self.by_u * v - self.by_v * u
        self.by_radius, self.by_blur = (
            (face.pair(s, s.radius + a, s.blur + b) - face.pair(s, s.radius - a, s.blur - b)) / (2 * H)
            for a, b in ((H, 0.0), (0.0, H))
        )


def _slope(square: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Derivative by a pixel, of fourth order."""
    a, b, c, d = (np.roll(square, s, axis) for s in (2, 1, -1, -2))
    return np.asarray((a - 8.0 * b + 8.0 * c - d) * FINE / 12.0)


def _laying(f: _Frame, p: Place, exposure: float, k: int) -> tuple[csr_array, csr_array]:
    """Matrices (pixels, k k) that lay a picture in a frame, and its derivative by the exposure from slopes along the
    way. Cubic convolution (Keys 1981)."""
    way = exposure * math.hypot(*f.velocity)
    n = 1 + math.ceil(2 * way)  # two pieces of a streak to a pixel
    parts = (np.arange(n) + 0.5) / n - 0.5
    c, s = math.cos(p.turn), math.sin(p.turn)
    du = f.u[:, None] - p.x - parts * exposure * f.velocity[0]
    dv = f.v[:, None] - p.y - parts * exposure * f.velocity[1]
    at = FINE * (c * du + s * dv) + 0.5 * (k - 1), FINE * (c * dv - s * du) + 0.5 * (k - 1)
    base = [np.clip(np.floor(a).astype(np.int64), 1, k - 3) for a in at]
    taps = [_keys(np.clip(a - b, 0.0, 1.0)) for a, b in zip(at, base, strict=True)]
    four = np.arange(-1, 3)
    column = (base[1][..., None, None] + four[:, None]) * k + base[0][..., None, None] + four
    weight = taps[1][..., :, None] * taps[0][..., None, :] / n
    row = np.broadcast_to(np.arange(f.u.size)[:, None, None, None], column.shape)
    shape, where = (f.u.size, k * k), (row.ravel(), column.ravel())
    first = csr_array((weight.ravel(), where), shape=shape)
    second = csr_array(((weight * parts[:, None, None]).ravel(), where), shape=shape)
    return first, second


def _keys(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights (..., 4) of the points about a place t in 0..1 after the second."""
    return np.stack(
        [
            ((-0.5 * t + 1.0) * t - 0.5) * t,
            (1.5 * t - 2.5) * t * t + 1.0,
            ((-1.5 * t + 2.0) * t + 0.5) * t,
            (0.5 * t - 0.5) * t * t,
        ],
        axis=-1,
    )


class _Equations:
    """Normal equations of one frame, weighted: h (5, 5) of its own unknowns, c (shared, 5), n (shared, shared) of the
    shared ones (waves, radius, blur, exposure), g and b their right sides; noise [grey]. alone: no shared ones."""

    def __init__(self, f: _Frame, p: Place, s: _Shared, pictures: _Pictures, prior: Array, alone: bool = False):
        lay, along = _laying(f, p, s.exposure, pictures.k)
        laid = (pictures.value, pictures.by_u, pictures.by_v, pictures.by_turn, pictures.by_radius, pictures.by_blur)
        (a, m), (a_u, m_u), (a_v, m_v), (a_t, m_t), (a_r, m_r), (a_b, m_b) = (np.asarray(lay @ v.T).T for v in laid)
        cos, sin = math.cos(p.turn), math.sin(p.turn)
        bright = p.light - f.behind

        def change(share: Array, face: Array) -> Array:
            return bright * share + p.contrast * face

        by_u, by_v = change(a_u, m_u), change(a_v, m_v)
        x, y = -(cos * by_u - sin * by_v), -(sin * by_u + cos * by_v)
        e_u, e_v = (change(*np.asarray(along @ v.T).T) for v in (pictures.by_u, pictures.by_v))
        vx, vy = f.velocity
        exposure = -vx * (cos * e_u - sin * e_v) - vy * (sin * e_u + cos * e_v)
        own = np.stack([x, y, change(a_t, m_t), a, m], axis=1)
        shared = np.zeros((f.u.size, 0))
        if not alone:
            waves = p.contrast * np.asarray(lay.astype(np.float32) @ pictures.stack, np.float64)
            shared = np.column_stack([waves, change(a_r, m_r), change(a_b, m_b), exposure])
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
        self.h, self.c, self.n = own.T @ own, shared.T @ own, shared.T @ shared
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


def adjusted(frames: Frames, scene: Float32, places: list[Place], layer: Layer, outlined: bool) -> Adjusted | None:
    """The places [one a frame] of a learned layer, all fitted at once; None where the fit does not come to rest.
    outlined: the layer's diameter is that of an outline, and not only about right."""
    if layer.d > 40.0:  # a larger ball would have more than some hundred waves
        return None
    good = [i for i, p in enumerate(places) if not p.found.flag]
    cuts = {i: _cut(np.asarray(frames[i], np.float32), scene, places, i, layer.d) for i in good}
    teach = good[:: max(1, math.ceil(len(good) / 40))]
    face = _Face(0.5 * layer.d)
    shown = layer.shown[layer.alpha > 0.5]
    height = float(np.std(shown)) + abs(float(np.median(shown)))
    widest = np.array([(FREE * height) ** 2, FREE**2])
    shared = _Shared(np.zeros(face.falls.size), 0.5 * layer.d, BLUR[0], 0.0)
    film = _Film(
        (0.5 * layer.d, OUTLINE_RADIUS.value[not outlined] ** 2),
        shared,
        {i: places[i] for i in good},
        height**2,
        widest,
    )
    for turn in range(TURNS):
        pictures = _Pictures(face, film.shared)
        equations = {i: _Equations(cuts[i], film.places[i], film.shared, pictures, film.prior) for i in teach}
        if turn in (FIRST // 2, FIRST):
            odd = _odd(equations, film.places, widest)
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
    expected = _centred(places, film.places, teach)
    film.places |= {i: p for i, p in expected.items() if i not in teach}
    apart = [float(np.median(np.abs(np.asarray(frames[i], np.float32) - scene))) for i in teach]
    at_ball = float(np.median([e.noise for e in equations.values()]))
    found, centre = _measured(film, face, cuts, cov, expected, widest)
    out = [found.get(i, p) for i, p in enumerate(places)]
    return Adjusted(out, centre, at_ball / max(FROM_MAD * float(np.median(apart)), 1e-9))


def _odd(equations: dict[int, _Equations], places: dict[int, Place], widest: Array) -> dict[int, float]:
    """Frames whose ball is not that of the others, each with by how many times as much it is off the picture: it is
    another thing that has been made alike by another light."""
    off = np.array([e.off for e in equations.values()])
    times = np.sqrt(off / max(float(np.median(off)), 1e-12))
    light = np.array([[places[i].light, places[i].contrast] for i in equations])
    # light or contrast beyond 3 times the widest is not the ball's
    far = np.abs(light - np.median(light, axis=0)) > 3.0 * np.sqrt(widest)
    # and so is what leaves 2.8 times as much as in most frames
    return {i: float(t) for i, t, f in zip(equations, times, far.any(axis=1), strict=True) if f or t > 2.8}


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
    told = float(np.sum(1.0 - number * np.diag(cov)[:w]))  # waves that the film tells (MacKay 1992)
    film.variance = float(np.sum(number * film.shared.waves**2) * film.variance / max(told, 1.0))
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


def _measured(
    film: _Film, face: _Face, cuts: dict[int, _Frame], cov: Array, expected: dict[int, Place], widest: Array
) -> tuple[dict[int, Place], float]:
    """Every good frame fitted with the shared unknowns as they are; sigma: its own, and what theirs cost it beyond what
    they cost all alike. And the standard uncertainty of the centre in the ball's picture [px]."""
    s, pictures, last = film.shared, _Pictures(face, film.shared), dict[int, _Equations]()
    for i, cut in cuts.items():
        for _ in range(12):  # the shared unknowns stay as they are
            e = _Equations(cut, film.places[i], s, pictures, film.prior, alone=True)
            film.places[i], far = _placed(film.places[i], np.linalg.solve(e.h, e.g), e)
            if far < REST:
                break
        last[i] = _Equations(cut, film.places[i], s, pictures, film.prior)
    costs = {i: np.linalg.solve(e.h, e.c.T)[:2] for i, e in last.items()}
    usual, odd = np.mean(list(costs.values()), axis=0), _odd(last, film.places, widest)
    out = dict[int, Place]()
    for i, e in last.items():
        off = costs[i] - usual
        var = np.linalg.inv(e.h)[:2, :2] * e.power / e.noise**2 / max(e.count - 5.0, 1.0) + off @ cov @ off.T
        sigma, p = math.sqrt(max(var[0, 0], var[1, 1])), film.places[i]
        # a place may move by half of the radius
        away = math.hypot(p.x - expected[i].x, p.y - expected[i].y) > 0.5 * s.radius
        found = Found(GOOD, p.x, p.y, sigma, 2.0 * s.radius, e.unlike)
        if away or i in odd:
            found = Found(Flag(Reason.NOT_CONVERGED) if away else Flag(Reason.UNLIKE_OTHERS, (odd[i],)))
        out[i] = replace(p, found=found)
    turned = [_turned(film.places[i].turn) @ c for i, c in costs.items()]
    centre = np.mean(turned, axis=0)
    return out, math.sqrt(float(np.max(np.diag(centre @ cov @ centre.T))))


def _centred(before: list[Place], after: dict[int, Place], teach: list[int]) -> dict[int, Place]:
    """Places before the fit, moved by as much in the ball's picture, and turned, as it moved those that taught."""
    moves = [_turned(before[i].turn) @ [after[i].x - before[i].x, after[i].y - before[i].y] for i in teach]
    u, v = np.median(moves, axis=0)
    turn = float(np.median([after[i].turn - before[i].turn for i in teach]))
    moved = {i: shifted(before[i], float(u), float(v)) for i in after}
    return {i: replace(p, turn=p.turn + turn, light=0.0, contrast=1.0) for i, p in moved.items()}


def _turned(turn: float) -> Array:
    """Matrix that turns (x, y) back into a ball's own picture."""
    c, s = math.cos(turn), math.sin(turn)
    return np.array([[c, s], [-s, c]])


def _cut(image: Float32, scene: Float32, places: list[Place], i: int, d: float) -> _Frame:
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
