"""Discs beside LAMMPS on the same system in the same run: a markdown table on standard output.

    python -m benchmarks.dem

5,000 bidisperse discs at area fraction 0.80 between four walls, thermal motion, gravity, restitution 0.8, 30 steps a
contact; LAMMPS `gran/hooke` with the friction switched off, one process, at the best of four skins for each; then both
with friction 0.5 (`gran/hooke/history`). Runs take turns; the table gives the least CPU time of three.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

from jumpvision.dem import motion
from jumpvision.dem.discs import Block, Box, Law, Plate
from jumpvision.dem.packing import pack

sys.path.insert(0, "tests")
import lammps_peer

STEPS, D = 4000, 1e-3
SKINS = (0.1, 0.2, 0.3, 0.5)  # mean diameters


def main() -> None:
    rng = np.random.default_rng(1)
    box = Box(-0.035, 0.035, -0.072, 0.0)
    d = pack(box, 0.80, diameter=D, density=1.0, rng=rng)
    n = len(d.x)
    hot = replace(d, vx=rng.normal(0.0, 0.2, n), vy=rng.normal(0.0, 0.2, n))
    law = Law.bouncing(0.8, 3e-5, 0.5 * float(d.mass.min()), gravity=9.81)
    dt = motion.time_step(d, law)
    try:
        lammps_peer.load()
    except ImportError as error:
        print(f"LAMMPS left out: {error}\n")
        peer = False
    else:
        peer = True
    best: dict[str, float] = {}
    rough = replace(law, friction=0.5)
    for label, lammps, rule in (("ours", "LAMMPS gran/hooke", law),
                                ("ours, friction", "LAMMPS gran/hooke/history", rough)):  # fmt: skip
        motion.integrate(hot, rule, box, times=[0.0, dt], dt=dt)  # compiled
        for _ in range(3):
            for skin in SKINS:
                motion.SKIN = skin
                began = time.process_time()
                motion.integrate(hot, rule, box, times=[0.0, STEPS * dt], dt=dt)
                keep(best, label, began)
                if peer:
                    lmp = lammps_peer.start(hot, rule, box, dt=dt, skin=skin * D)
                    lmp.command("run 0 post no")
                    began = time.process_time()
                    lmp.command(f"run {STEPS} pre no post no")
                    keep(best, lammps, began)
                    lmp.close()
    motion.SKIN = 0.3
    t = np.linspace(0.0, STEPS * dt, 5)
    carpet = replace(law, gravity=0.0, coulomb=5.0)
    for name, foot in (("ours, plate and Coulomb drag", Plate(0.01, 0.01)),
                       ("ours, row of grains and Coulomb drag", Block.row(0.01, 0.5 * D))):  # fmt: skip
        for _ in range(3):
            began = time.process_time()
            motion.integrate(d, carpet, replace(box, top=np.inf), times=t, dt=dt, foot=foot, foot_t=t, foot_y=-0.5 * t)
            keep(best, name, began)
    print(f"{n} discs, one core:\n")
    print("| | steps/s | disc-steps/s | against LAMMPS |\n|---|---|---|---|")
    for name, seconds in best.items():
        rival = best.get(
            "LAMMPS gran/hooke/history" if "friction" in name or "history" in name else "LAMMPS gran/hooke"
        )
        ratio = f"{rival / seconds:.1f}" if rival and "Coulomb" not in name else ""
        print(f"| {name} | {STEPS / seconds:,.0f} | {n * STEPS / seconds / 1e6:.0f} M | {ratio} |")


def keep(best: dict[str, float], name: str, began: float) -> None:
    """The shortest time so far."""
    best[name] = min(best.get(name, np.inf), time.process_time() - began)


if __name__ == "__main__":
    main()
