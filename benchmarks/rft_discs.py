"""Resistive force theory beside our own discs: bars and bodies pushed down into a heavy bed in two dimensions.

    python -m benchmarks.rft_discs [--beds 2] [--file ROWS] [--workers 2]

Discs of 2 mm (two sizes) that rub (coefficient 0.5) settle under gravity; a bar of 30 mm, inclined by 0 to 75 degrees,
a wedge and half a round go down at 0.3 m/s. The force per depth of a bar is a line of the theory's table. Compared are
(1) the table of the discs beside the published generic laws, both with one scale, that of the level bar; (2) the theory
itself: the bodies' forces from the discs' own bars, by `physics.rft.push`, beside those that the discs put on them.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np

from benchmarks.rows import Row, gather
from jumpvision.base.arrays import Array
from jumpvision.jumper.physics.rft import Grains, Map, generic_2d, generic_3d, gridded, of_plane, push
from jumpvision.laboratory.dem.discs import Block, Box, Discs, Law
from jumpvision.laboratory.dem.motion import integrate, time_step
from jumpvision.laboratory.dem.packing import pack

SPEED, GRAVITY, RUB = 0.3, 9.81, 0.5  # m/s; m/s^2; coefficient of friction
WIDE = 15.0  # grains: length of a bar
ANGLES = (0, 15, 30, 45, 60, 75)  # degrees
BODIES = ("wedge", "half round")


@dataclass(frozen=True)
class Case:
    """One body in one bed; grain [m], half width and depth of the bed in grains."""

    body: str  # "bar 30", "wedge", "half round"
    seed: int
    grain: float = 2e-3
    half: float = 60.0
    deep: float = 60.0

    @property
    def key(self) -> str:
        return f"{self.body} bed {self.seed}"


def outline(body: str, grain: float) -> Array:
    """Lower side of a body from left to right, (n, 2) [m], x and height over its middle."""
    size = WIDE * grain
    if body.startswith("bar"):
        a = math.radians(float(body.split()[1]))
        s = np.linspace(-0.5, 0.5, 41)[:, None] * size
        return s * [math.cos(a), math.sin(a)]
    if body == "wedge":  # 45 degrees
        x = np.linspace(-0.5, 0.5, 41) * size
        return np.stack([x, np.abs(x)], axis=1)
    a = np.linspace(-math.pi, 0.0, 61)
    return 0.5 * size * np.stack([np.cos(a), np.sin(a)], axis=1)


def settled(c: Case) -> tuple[Discs, Law, float]:
    """The bed at rest under its weight, its law, and the height of its surface [m]."""
    w, h = c.half * c.grain, c.deep * c.grain
    rng = np.random.default_rng(c.seed)
    d = pack(Box(-w, w, -h, 0.0), 0.80, diameter=c.grain, density=1.0, rng=rng, kind="bi")
    law = Law.bouncing(0.3, 4e-4, 0.5 * float(d.mass.min()), gravity=GRAVITY, friction=RUB)
    m = integrate(d, law, Box(-w, w, -h), times=[0.0, 0.2, 0.4], dt=time_step(d, law))
    d = m.last(d)
    places = np.linspace(-0.7 * w, 0.7 * w, 17)
    tops = [(d.y + d.radius)[np.abs(d.x - x) < 3 * c.grain].max() for x in places]
    return d, law, float(np.mean(tops)) - 0.3 * c.grain  # the highest of six grains stands out by so much


def run(c: Case) -> Row:
    """Vertical and horizontal force per depth of the body's middle and per length of 30 mm, over rho g."""
    d, law, surface = settled(c)
    w, h = c.half * c.grain, c.deep * c.grain
    line, r = outline(c.body, c.grain), 0.375 * c.grain
    low = line[:, 1].min()
    foot = Block(line[:, 0], line[:, 1] - low + r, np.full(len(line), r))
    half = 0.5 * float(np.ptp(line[:, 1]))
    go = 0.62 * h
    t = np.linspace(0.0, go / SPEED, 76)
    m = integrate(
        d,
        law,
        Box(-w, w, -h),
        times=t,
        dt=time_step(d, law),
        foot=foot,
        foot_t=t,
        foot_y=surface + c.grain - SPEED * t,
    )
    depth = surface - (m.foot_y - low)  # of the outline's origin
    use = depth > 3 * c.grain + 2 * half
    f, z = -m.foot_force[use], depth[use]
    rho = float(d.mass.sum()) / (2 * w * (surface + h))
    per = (f * z[:, None]).sum(axis=0) / (z @ z) / (WIDE * c.grain * rho * GRAVITY)
    return {"body": c.body, "x": float(per[0]), "z": float(per[1])}


def theory(body: str, stresses: Map | None) -> Array:
    """(x, z) of the body as `run` tells them, by `push` on a prism of it; None: the generic law in space."""
    line, depth = outline(body, 1.0), 40.0
    a, b = line[:-1], line[1:]

    def at(p: Array, y: float) -> Array:
        return np.column_stack([p[:, 0], np.full(len(p), y), p[:, 1] - depth])

    y = 1000.0  # long, so that the middle counts
    sides = [np.stack(s, axis=1) for s in ((at(a, 0), at(b, y), at(b, 0)), (at(a, 0), at(a, y), at(b, y)))]
    law = generic_3d if stresses is None else of_plane(stresses)
    rubbing = RUB if stresses is None else 1e3  # a map of plates has their friction in it
    found = push(np.concatenate(sides), (0.0, 0.0, -1.0), grains=Grains(1.0, rubbing, stress=law)).force
    return found[[0, 2]] / (y * WIDE * depth)


def table_of(rows: list[Row]) -> Map:
    """The discs' bars as a table of the theory, for motion straight down; a bar tilted the other way is its mirror."""
    x, z = (np.array([np.mean([r[k] for r in rows if r["body"] == f"bar {a}"]) for a in ANGLES]) for k in "xz")
    plate = np.radians(np.concatenate([-np.array(ANGLES[:0:-1]), ANGLES, [90.0]]))
    both = np.concatenate([x[:0:-1], -x, [0.0]]), np.concatenate([z[:0:-1], z, [0.0]])
    plate, both = np.r_[-0.5 * math.pi, plate], tuple(np.r_[0.0, v] for v in both)
    p, m = np.meshgrid(plate, [-0.5 * math.pi, 0.5 * math.pi], indexing="ij")
    up = np.repeat(both[1][:, None], 2, axis=1) * [0.0, 1.0]
    along = np.repeat(both[0][:, None], 2, axis=1)
    return gridded(p.ravel(), m.ravel(), along.ravel(), up.ravel())


def tell(rows: list[Row]) -> None:
    """Both tables, failed rows first, then the worst."""
    for r in rows:
        if "failed" in r:
            print(f"FAILED {r['key']}: {r['failed']}")
    rows = [r for r in rows if "failed" not in r]
    level = [np.mean([r["z"] for r in rows if r["body"] == "bar 0"])]
    level += [theory("bar 0", s)[1] for s in (generic_2d, None)]
    lines = []
    for a in ANGLES:
        mine = np.array([[r["x"], r["z"]] for r in rows if r["body"] == f"bar {a}"]) / level[0]
        li, agarwal = theory(f"bar {a}", generic_2d) / level[1], theory(f"bar {a}", None) / level[2]
        off = np.abs(mine.mean(axis=0) - li).max()
        lines.append(
            (off, f"| bar {a} | {_both(mine)} | {li[1]:.2f}, {li[0]:.2f} | {agarwal[1]:.2f}, {agarwal[0]:.2f} |")
        )
    print(f"level bar: {level[0]:.2f} rho g depth, a length of 15 grains\n")
    print("| body | discs: up, along (beds) | Li et al. 2013 | Agarwal et al. 2023 |\n|---|---|---|---|")
    print("\n".join(text for _, text in sorted(lines, reverse=True)))
    print("\n| body | discs | theory with the discs' own bars | off | with Li et al. |\n|---|---|---|---|---|")
    table = table_of(rows)
    for body in BODIES:
        mine = np.array([[r["x"], r["z"]] for r in rows if r["body"] == body]) / level[0]
        if mine.size:
            own, li = theory(body, table)[1] / level[0], theory(body, generic_2d)[1] / level[1]
            print(f"| {body} | {_both(mine)} | {own:.2f} | {100 * (own / mine[:, 1].mean() - 1):+.0f} % | {li:.2f} |")


def _both(mine: Array) -> str:
    beds = " / ".join(f"{z:.2f}" for z in mine[:, 1])
    return f"{mine[:, 1].mean():.2f}, {mine[:, 0].mean():.2f} ({beds})"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beds", type=int, default=2)
    parser.add_argument("--file")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    bodies = [*(f"bar {a}" for a in ANGLES), *BODIES]
    cases = [Case(b, s) for s in range(1, given.beds + 1) for b in bodies]
    tell(gather(cases, run, given.file, given.workers))
