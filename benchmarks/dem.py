"""Discs beside LAMMPS on the same system in the same run: a markdown table on standard output.

    python -m benchmarks.dem [--repeats 5]

Bidisperse discs at area fraction 0.80 between four walls, thermal motion, gravity, restitution 0.8, 30 steps a contact;
LAMMPS `gran/hooke` with the friction switched off; then both with friction 0.5 (`gran/hooke/history`). Ours on one and
on all threads, LAMMPS on as many MPI processes, at the better of two skins for each. Runs take turns; a time is the
mean over slices of the least wall time of each, for on a shared machine MPI processes wait for one another.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace

import numpy as np

from jumpvision.base.threads import at_most, threads
from jumpvision.laboratory.dem import motion
from jumpvision.laboratory.dem.discs import Block, Box, Discs, Law, Plate
from jumpvision.laboratory.dem.packing import pack

sys.path.insert(0, "tests")
import lammps_peer

D = 1e-3
SLICES = 8
SKINS = (0.2, 0.3)  # mean diameters


def ours(spent: list[float], *what: object, **how: object) -> list[float]:
    """Wall seconds of each interval of `integrate`, less what comes before and after all of them."""
    spent.clear()
    motion.integrate(*what, **how)  # type: ignore[arg-type]
    return list(spent)


def tiled(d: Discs, box: Box, across: int, down: int) -> tuple[Discs, Box]:
    """A larger bed of copies of one."""
    width, height = box.right - box.left, box.top - box.bottom
    x, y = (a.ravel() for a in np.meshgrid(np.arange(across) * width, -np.arange(down) * height))
    size = [np.tile(a, x.size) for a in (d.radius, d.mass)]
    x, y = np.add.outer(x, d.x).ravel(), np.add.outer(y, d.y).ravel()
    return Discs(x, y, *size, 0.0 * x, 0.0 * x), Box(box.left, box.left + across * width, -down * height, box.top)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    rng = np.random.default_rng(1)
    box = Box(-0.035, 0.035, -0.072, 0.0)
    bed = pack(box, 0.80, diameter=D, density=1.0, rng=rng)
    law = Law.bouncing(0.8, 3e-5, 0.5 * float(bed.mass.min()), gravity=9.81)
    dt = motion.time_step(bed, law)
    try:
        lammps_peer.load()
        peer = True
    except ImportError as error:
        print(f"LAMMPS left out: {error}\n")
        peer = False
    spent: list[float] = []
    march = motion.Bands.march

    def timed(self: motion.Bands, *what: object) -> object:
        began = time.perf_counter()
        found = march(self, *what)  # type: ignore[arg-type]
        spent.append(time.perf_counter() - began)
        return found

    motion.Bands.march = timed  # type: ignore[assignment,method-assign]
    print("| discs | contacts | cores | ours, steps/s | disc-steps/s | LAMMPS, steps/s | ratio |")
    print("|---|---|---|---|---|---|---|")
    for d, walls, steps in ((bed, box, 500), (*tiled(bed, box, 5, 4), 50)):
        n = len(d.x)
        hot = replace(d, vx=rng.normal(0.0, 0.2, n), vy=rng.normal(0.0, 0.2, n))
        times = np.arange(SLICES + 1) * steps * dt
        for label, rule in (("smooth", law), ("friction 0.5", replace(law, friction=0.5))):
            motion.integrate(hot, rule, walls, times=[0.0, dt], dt=dt)  # compiled
            best: dict[tuple[str, int], float] = {}
            for skin in SKINS:
                motion.SKIN = skin
                all_of: dict[tuple[str, int], list[list[float]]] = {}
                for _ in range(repeats):
                    for cores in sorted({1, threads()}):
                        with at_most(cores):
                            found = ours(spent, hot, rule, walls, times=times, dt=dt)
                        all_of.setdefault(("ours", cores), []).append(found)
                        if peer:
                            how = {"dt": dt, "skin": skin * D, "steps": steps, "slices": SLICES, "processes": cores}
                            all_of.setdefault(("LAMMPS", cores), []).append(lammps_peer.shared(hot, rule, walls, **how))
                for key, rows in all_of.items():
                    best[key] = min(best.get(key, np.inf), float(np.min(rows, axis=0).mean()) / steps)
            for cores in sorted({1, threads()}):
                mine, theirs = best["ours", cores], best.get(("LAMMPS", cores), np.nan)
                row = f"| {n} | {label} | {cores} | {1 / mine:,.0f} | {n / mine / 1e6:.0f} M "
                print(row + (f"| {1 / theirs:,.0f} | {theirs / mine:.1f} |" if peer else "| | |"), flush=True)
    motion.SKIN = 0.3
    t = np.arange(SLICES + 1) * 500 * dt
    carpet = replace(law, gravity=0.0, coulomb=5.0)
    print()
    for name, foot in (("plate", Plate(0.01, 0.01)), ("row of grains", Block.row(0.01, 0.5 * D))):
        how = {"times": t, "dt": dt, "foot": foot, "foot_t": t, "foot_y": -0.5 * t}
        rows = [ours(spent, bed, carpet, replace(box, top=np.inf), **how) for _ in range(repeats)]
        rate = 500 / float(np.min(rows, axis=0).mean())
        print(f"Under a {name} with Coulomb drag, {len(bed.x)} discs, all cores: {rate:,.0f} steps/s.")


if __name__ == "__main__":
    main()
