"""Where the rim of a ball of any face is, in a picture of what changes with it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from jumpvision.base.arrays import FROM_MAD, Float32

RAYS, WEAK = 64, 0.12  # of an outline; least change just inside it, of the strongest
CLOSED = 0.6  # least share of the rays on which what is seen ends at the rim
ROUND = 0.08  # diameters: largest scatter of an outline about its circle
REACH = 3.0  # px beyond the rim, that are fitted
BARE, STRANGE = 1.5, 0.15  # px from the rim; of the change: what is not the ball's
FINEST = 1.5  # px: shortest half wave of a face
ROUGH = 0.01  # weight of a face's waves in the fit, by the square of their number in a radius
TRIALS, FAR = 12, 0.1  # of a rim; diameters that it may lie off the outline
BLUR = 0.75, 0.3  # px: of a rim, first and least


def outline(change: Float32, d: float) -> tuple[float, float, float] | None:
    """Centre (u, v) from the middle of a picture (k, k) of a change, and diameter, of what is about d wide [px]; None
    where it is not round.

    Where the change falls to half of what it is just inside, along RAYS from the centre; a circle through these.
    """
    k = change.shape[0]
    u = v = 0.0
    size = d
    angle = np.arange(RAYS) * 2 * math.pi / RAYS
    for turn in range(5):
        r = np.arange(0.0, 0.5 * k, 0.1)
        x, y = (c + np.outer(f(angle), r) for c, f in ((u, np.cos), (v, np.sin)))
        shift = np.float32((k - 1) / 2)
        rays = cv2.remap(change, x.astype(np.float32) + shift, y.astype(np.float32) + shift, cv2.INTER_CUBIC)
        rim = 0.5 * size
        inner = (r > rim - max(0.35 * rim, 2.8)) & (r < rim - 1.3)
        basis = np.stack([np.ones(inner.sum()), r[inner] - rim], axis=1)
        line = np.linalg.lstsq(basis, rays[:, inner].T, rcond=None)[0]
        height = line[0]  # what the rim would show, were it sharp
        at, strong = np.full(RAYS, np.nan), np.abs(height) > WEAK * np.percentile(np.abs(height), 90)
        band = 1.5 if turn else max(3.0, 0.4 * rim)
        begin, end = np.searchsorted(r, [rim - band, rim + band])
        for q in range(RAYS):
            below = np.flatnonzero(rays[q, begin:end] / height[q] < 0.5)
            if below.size and below[0] and strong[q]:
                at[q] = r[begin + below[0]]
        ok = np.isfinite(at)
        if turn and np.mean(ok[strong]) < CLOSED:
            return None
        for _ in range(3):
            if ok.sum() < RAYS // 5:
                return None
            weight = np.abs(height[ok])
            ex, ey = u + at[ok] * np.cos(angle[ok]), v + at[ok] * np.sin(angle[ok])
            a = np.stack([ex, ey, np.ones(ok.sum())], axis=1) * weight[:, None]
            cu, cv, c0 = np.linalg.lstsq(a, weight * (ex**2 + ey**2), rcond=None)[0]
            centre, radius = (0.5 * cu, 0.5 * cv), math.sqrt(max(c0 + 0.25 * (cu**2 + cv**2), 1e-6))
            off = np.hypot(u + at * np.cos(angle) - centre[0], v + at * np.sin(angle) - centre[1]) - radius
            spread = FROM_MAD * float(np.nanmedian(np.abs(off[ok])))
            ok = np.isfinite(at) & (np.abs(off) < max(3.0 * spread, 0.1))
        u, v, size = float(centre[0]), float(centre[1]), 2.0 * radius
        if not (math.hypot(u, v) < 0.4 * d and 0.6 < size / d < 1.6):
            return None
    return (u, v, size) if spread < ROUND * size else None


def share(
    x: float, y: float, radius: float, blur: float, u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Share of a disc in the pixels at (u, v), seen with a Gaussian blur [px]."""
    return np.asarray(ndtr((radius - np.hypot(u - x, v - y)) / blur))


def rim(change: Float32, behind: Float32, start: tuple[float, float, float]) -> tuple[float, float, float, float]:
    """Centre (u, v), diameter and blur [px] of the disc near a start, of which a picture shows share x (face - behind).

    The face is a sum of waves, solved for at each trial of these four (variable projection, Golub and Pereyra 1973). A
    blur of disc x face is share x face + blur^2 grad share . grad face, to second order. Where the outline's rays take
    a face for straight near the rim, this takes it for smooth: 0.03 px of a textured ball instead of 0.1.
    """
    k = change.shape[0]
    v, u = np.indices((k, k)) - (k - 1) / 2
    beyond = np.hypot(u - start[0], v - start[1]) - 0.5 * start[2]
    strange = (beyond > BARE) & (np.abs(change) > STRANGE * np.std(change[beyond < REACH]))  # as a shadow
    part = (beyond < REACH) & (cv2.dilate(strange.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    u, v, data, scene = u[part], v[part], change[part], behind[part]
    side = start[2] + 2 * REACH
    wave = math.pi * np.arange(1 + round(side / FINEST)) / side
    across, down = ((w[:, None] - c + 0.5 * side) * wave for w, c in ((u, start[0]), (v, start[1])))
    cu, cv, su, sv = np.cos(across), np.cos(down), -wave * np.sin(across), -wave * np.sin(down)
    face, face_u, face_v = (
        np.einsum("pi,pj->pij", a, b).reshape(len(u), -1) for a, b in ((cu, cv), (su, cv), (cu, sv))
    )
    rough = np.diag(ROUGH * (1.0 + (wave[:, None] ** 2 + wave**2).ravel() * (0.5 * start[2]) ** 2))

    def left(p: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, radius, blur = p
        blur = max(abs(blur), BLUR[1])
        off = np.maximum(np.hypot(u - x, v - y), 1e-6)
        part = share(x, y, radius, blur, u, v)
        slope = -np.exp(-0.5 * ((radius - off) / blur) ** 2) / (blur * math.sqrt(2 * math.pi) * off)
        turned = (slope * (u - x))[:, None] * face_u + (slope * (v - y))[:, None] * face_v
        a = part[:, None] * face + blur**2 * turned
        b = data + part * scene
        waves = np.linalg.solve(a.T @ a + rough**2, a.T @ b)
        return np.concatenate([a @ waves - b, rough @ waves]) / float(np.std(data))

    first = np.array([start[0], start[1], 0.5 * start[2], BLUR[0]])
    x, y, radius, blur = least_squares(left, first, xtol=1e-5, ftol=1e-8, max_nfev=TRIALS).x
    if max(abs(x - start[0]), abs(y - start[1]), abs(radius - first[2])) > FAR * start[2]:
        return *start, BLUR[0]
    return float(x), float(y), 2.0 * float(radius), max(abs(float(blur)), BLUR[1])
