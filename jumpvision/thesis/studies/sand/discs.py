"""Discs under a foot as a command: beds of a lattice or at random, their motion, and what moves with the foot."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from jumpvision.base.progress import WORKERS, in_parts, setting
from jumpvision.base.record import plain
from jumpvision.base.schema import InputError, param, read
from jumpvision.base.storage import write_aside
from jumpvision.experiment.workflow.entries import versions
from jumpvision.laboratory.dem.discs import Box, Discs, Law, Plate
from jumpvision.laboratory.dem.motion import integrate, time_step
from jumpvision.laboratory.dem.packing import LATTICES, lattice, pack
from jumpvision.laboratory.dem.plug import Plug, plug_of
from jumpvision.thesis.studies.compute import write

FILE = "dem.nc"
FRAMES = 40  # instants of the stroke
RAMP = 2e-3  # s, in which the foot comes to its speed
CONSTANT = 0.5  # of the stroke: theta is the median from there on


@dataclass(frozen=True)
class DiscBed:
    """A bed of discs on a carpet, and the stroke of the foot."""

    bed: str = param("random", "", "how the discs lie", choices=("random", *LATTICES))
    fraction: float = param(0.0, "", "of the area; 0: 0.72 at random, 0.85 hexagonal, 0.75 square", lo=0, hi=0.907)
    sizes: str = param("bi", "", "of a random bed", choices=("mono", "bi", "poly"))
    diameter: float = param(1e-3, "m", "of the grains, mean", lo=1e-5, hi=0.1)
    half_width: float = param(0.05, "m", "of the bed", lo=1e-3, hi=10)
    depth: float = param(0.07, "m", "of the bed", lo=1e-3, hi=10)
    foot: float = param(0.015, "m", "half width of the foot", lo=1e-4, hi=5)
    stroke: float = param(0.008, "m", "how deep the foot goes", lo=1e-5, hi=5)
    speed: float = param(0.4, "m/s", "of the foot", lo=1e-3, hi=20)
    carpet: float = param(10.0, "m/s^2", "deceleration of a sliding disc by what it lies on", lo=0, hi=1e4)
    friction: float = param(0.0, "", "coefficient between grains, foot and walls", lo=0, hi=2)
    restitution: float = param(0.5, "", "of a collision", lo=0.01, hi=1)
    density: float = param(1.0, "kg/m^2", "of a disc", lo=0, hi=1e6, open_lo=True)

    @property
    def filled(self) -> float:
        """The area fraction asked for, or the usual one of the bed."""
        return self.fraction or {"random": 0.72, "hexagonal": 0.85, "square": 0.75}[self.bed]


def checked(table: dict[str, object]) -> DiscBed:
    """The bed of keywords. InputError for values out of range, and for what does not fit together."""
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
    if problems:
        raise InputError(problems)
    return bed


def laid(bed: DiscBed, seed: int) -> Discs:
    """The discs at rest."""
    box = Box(-bed.half_width, bed.half_width, -bed.depth, 0.0)
    try:
        if bed.bed == "random":
            rng = np.random.default_rng(seed)
            return pack(
                box, bed.filled, diameter=bed.diameter, density=bed.density, rng=rng, kind=bed.sizes, rounds=20_000
            )
        return lattice(bed.bed, box, bed.filled, diameter=bed.diameter, density=bed.density)
    except ValueError as e:
        raise InputError([f"dem: {e}"]) from None


def pushed(seed: int, bed: DiscBed) -> xr.Dataset:
    """One bed under the foot: discs over (t, disc), the plug over t."""
    d = laid(bed, seed)
    # a collision of the two lightest discs takes 0.1 ms
    law = Law.bouncing(bed.restitution, 1e-4, 0.5 * float(d.mass.min()), coulomb=bed.carpet, friction=bed.friction)
    lasting = bed.stroke / bed.speed + RAMP
    fine = np.linspace(0.0, lasting, 400)
    path = -bed.speed * (fine - RAMP * -np.expm1(-fine / RAMP))
    times = np.linspace(0.0, lasting, FRAMES + 1)
    box = Box(-bed.half_width, bed.half_width, -bed.depth)
    # the foot's body is 20 mm high
    m = integrate(d, law, box, times=times, dt=time_step(d, law), foot=Plate(bed.foot, 0.02), foot_t=fine, foot_y=path)
    gone = np.diff(times)[:, None]
    fall, sink = np.diff(m.y, axis=0) / gone, np.diff(m.foot_y) / gone[:, 0]
    plugs = [Plug(*[math.nan] * 4)] + [
        plug_of(m.x[k], m.y[k], fall[k - 1], d.mass, d.radius, foot_y=float(m.foot_y[k]), foot_v=float(sink[k - 1]))
        for k in range(1, times.size)
    ]
    cells = {n: (("t", "disc"), getattr(m, n).astype(np.float32)) for n in ("x", "y", "vx", "vy")}
    front, theta, plug, momentum = np.array(plugs).T
    with np.errstate(divide="ignore", invalid="ignore"):
        added = np.concatenate([[math.nan], np.where(sink < -0.2 * bed.speed, -momentum[1:] / sink, np.nan)])
    series = {"foot_y": m.foot_y, "foot_v": m.foot_v, "foot_force": -m.foot_force[:, 1]}
    series |= dict(zip(Plug._fields, (front, theta, plug, momentum))) | {"added_mass": added}
    data = xr.Dataset(
        cells | {n: ("t", v) for n, v in series.items()} | {n: ("disc", getattr(d, n)) for n in ("radius", "mass")},
        coords={"t": times, "seed": seed},
    )
    for name, (unit, meaning) in VARIABLES.items():
        data[name].attrs = {"units": unit, "long_name": meaning}
    return data


VARIABLES = {
    "x": ("m", "right of the foot's axis"),
    "y": ("m", "up from the undisturbed surface"),
    "vx": ("m/s", "to the right"),
    "vy": ("m/s", "up"),
    "radius": ("m", "of a disc"),
    "mass": ("kg", "of a disc"),
    "foot_y": ("m", "height of the foot's face"),
    "foot_v": ("m/s", "velocity of the foot, up"),
    "foot_force": ("N", "mean force of the discs on the foot since the time before, up"),
    "front": ("m", "thickness of the plug below the face, on the axis"),
    "theta": ("degree", "angle of the plug's sides to the horizontal"),
    "plug": ("kg", "mass of the discs that go down with 0.9 of the foot's speed or more"),
    "momentum": ("kg m/s", "of all discs below the face, down"),
    "added_mass": ("kg", "momentum over the foot's speed, the discs' own"),
    "t": ("s", "since the foot began to move"),
}


@dataclass(frozen=True)
class DiscNumbers:
    """What a run of beds says; sigma: of the mean over the beds, NaN for one. Masses of discs, kg."""

    beds: int
    discs: int
    theta_deg: float
    theta_sigma_deg: float
    front_per_depth: float
    front_per_depth_sigma: float
    added_mass_kg: float
    added_mass_sigma_kg: float
    plug_kg: float
    plug_sigma_kg: float


def measured(runs: Sequence[xr.Dataset]) -> DiscNumbers:
    """theta, growth of the front with depth, added mass and plug at the end of the stroke, each a mean over the beds.

    Velocities are displacements between two instants over their distance: discs in contact tremble.
    """
    rows = []
    for data in runs:
        late = data.isel(t=slice(round(CONSTANT * FRAMES), None))
        depth, front = -data.foot_y.values, data.front.values
        grows = np.isfinite(front) & (
            # the front's growth is fitted until 0.8 of its greatest thickness
            np.arange(front.size) <= np.argmax(np.nan_to_num(front) > 0.8 * np.nanmax(front))
        )
        slope = np.polyfit(depth[grows], front[grows], 1)[0] if grows.sum() > 2 else math.nan
        with np.errstate(invalid="ignore"):
            theta = np.nanmedian(late.theta.values) if np.isfinite(late.theta.values).any() else math.nan
        rows.append((theta, slope, float(data.added_mass[-1]), float(data.plug[-1])))
    table = np.array(rows)
    mean = table.mean(axis=0)
    spread = table.std(axis=0, ddof=1) / math.sqrt(len(runs)) if len(runs) > 1 else np.full(4, math.nan)
    pairs = [float(a) for pair in zip(mean, spread) for a in pair]
    return DiscNumbers(len(runs), int(runs[0].sizes["disc"]), *pairs)


def run_beds(bed: DiscBed, beds: int, seed: int, workers: int) -> list[xr.Dataset]:
    """The beds of the seeds seed, seed + 1 ..., one a process."""
    laid(bed, seed)  # what does not fit is said before processes start
    with setting(WORKERS, workers):
        return list(in_parts(pushed, range(seed, seed + beds), bed))


def write_discs(runs: Sequence[xr.Dataset], bed: DiscBed, folder: Path, command: str) -> list[Path]:
    """dem.nc (the first bed in full, plug and foot of all) and dem.json, each in one step."""
    first, others = runs[0], [r[[n for n in r.data_vars if r[n].dims == ("t",)]] for r in runs]
    series = xr.concat(others, dim="bed", combine_attrs="drop_conflicts")
    data = xr.merge([first[["x", "y", "vx", "vy", "radius", "mass"]].drop_vars("seed"), series], join="exact")
    facts = {"command": command, "versions": versions(), "bed": asdict(bed)}
    data.attrs = {k: v if isinstance(v, str) else json.dumps(v) for k, v in facts.items()}
    made = [write(data, folder, FILE), folder / "dem.json"]
    write_aside(made[1], json.dumps(plain(facts | {"numbers": asdict(measured(runs))}), indent=1) + "\n")
    return made
