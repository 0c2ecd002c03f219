"""Bodies as triangles (n, 3, 3) [m], corners anticlockwise seen from outside: primitives, and STL files.

Primitives stand on z = 0 at their lowest point, about the axis x = y = 0.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Array

AROUND = 96  # corners of a circle


def revolved(radius: Array, height: Array) -> Array:
    """The body of revolution of a line from the axis below to the axis above: radius, height (m,) [m]."""
    turn = np.linspace(0.0, 2.0 * math.pi, AROUND + 1)
    wide = math.sqrt(2.0 * math.pi / (AROUND * math.sin(2.0 * math.pi / AROUND)))  # the polygon has the circle's area
    x, y = (wide * np.outer(radius, f(turn)) for f in (np.cos, np.sin))
    p = np.stack([x, y, np.repeat(height[:, None], AROUND + 1, axis=1)], axis=-1)
    a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, 1:], p[1:, :-1]
    both = np.concatenate([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)], axis=0).reshape(-1, 3, 3)
    area = np.linalg.norm(np.cross(both[:, 1] - both[:, 0], both[:, 2] - both[:, 0]), axis=1)
    return np.asarray(both[area > 1e-12 * area.max()])


def disc(radius: float, height: float) -> Array:
    """A flat disc, `height` thick."""
    return revolved(np.array([0.0, radius, radius, 0.0]), np.array([0.0, 0.0, height, height]))


def cone(radius: float, height: float) -> Array:
    """A cone with its tip down, closed above."""
    return revolved(np.array([0.0, radius, 0.0]), np.array([0.0, height, height]))


def sphere(radius: float) -> Array:
    """A sphere."""
    polar = np.linspace(0.0, math.pi, AROUND // 2 + 1)
    return revolved(radius * np.sin(polar), radius * (1.0 - np.cos(polar)))


def box(length: float, width: float, height: float) -> Array:
    """A box: length along x, width along y."""
    x, y = 0.5 * length, 0.5 * width
    p = np.array([(i, j, k) for k in (0.0, height) for i, j in ((-x, -y), (x, -y), (x, y), (-x, y))])
    sides = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    return np.array([[p[i] for i in (s[0], s[k], s[k + 1])] for s in sides for k in (1, 2)])


def tilted(triangles: Array, angle: float) -> Array:
    """Turned by `angle` [rad] about y, x towards -z: its lowest point is moved to z = 0 again."""
    c, s = math.cos(angle), math.sin(angle)
    turned = triangles @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return turned - np.array([0.0, 0.0, turned[..., 2].min()])


def volume(triangles: Array) -> float:
    """Of a closed body [m^3]; negative where its corners run clockwise."""
    return float(np.sum(np.linalg.det(triangles)) / 6.0)


RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(path: Path, unit: float) -> Array:
    """The triangles of an STL file, text or binary, in its `unit` [m]; the lowest point at z = 0.

    Turned inside out where the corners run clockwise. ValueError for what is no STL, is torn or encloses nothing.
    """
    data = path.read_bytes()
    count = int(np.frombuffer(data[80:84], "<u4")[0]) if len(data) >= 84 else 0
    if len(data) >= 84 and len(data) == 84 + RECORD.itemsize * count:
        corners = np.frombuffer(data[84:], RECORD)["corners"].astype(float)
    elif data.lstrip()[:5].lower() == b"solid" and b"facet" in data:
        words = data.decode("ascii", "replace").split()
        at = [i for i, w in enumerate(words) if w.lower() == "vertex"]
        try:
            corners = np.array([[float(x) for x in words[i + 1 : i + 4]] for i in at]).reshape(-1, 3, 3)
        except ValueError:
            raise ValueError(f"{path}: a vertex of the STL is no three numbers, or a triangle is not whole") from None
    else:
        sizes = (
            f"{count} triangles need {84 + RECORD.itemsize * count} bytes, it has {len(data)}" if count else "no facets"
        )
        raise ValueError(f"{path}: no whole STL file ({sizes}); export it again")
    if not len(corners) or not np.isfinite(corners).all():
        raise ValueError(f"{path}: the STL has no triangles, or corners that are no finite numbers")
    corners = corners * unit
    corners -= np.array([0.0, 0.0, corners[..., 2].min()])
    size, holds = float(np.ptp(corners.reshape(-1, 3), axis=0).max()), volume(corners)
    if abs(holds) < 1e-9 * size**3:
        raise ValueError(f"{path}: its triangles enclose no volume; an open surface has no inside: close it")
    return corners if holds > 0.0 else corners[:, ::-1]
