"""Resistive forces on a foot of any shape against depth, tilt and direction, as a command (`physics.rft`)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from jumpvision.base.arrays import Array
from jumpvision.base.progress import watch
from jumpvision.base.record import plain
from jumpvision.base.schema import InputError, param, read
from jumpvision.base.storage import sha256, write_aside
from jumpvision.experiment.inputs.logs import read_columns
from jumpvision.experiment.workflow.entries import versions
from jumpvision.jumper.physics import shapes
from jumpvision.jumper.physics.rft import (
    Grains,
    Profile,
    Table,
    cut,
    generic_2d,
    generic_3d,
    gridded,
    of_plane,
    profile,
    push,
)

UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254}
STRESS = {"N/m^3": 1.0, "N/cm^3": 1e6, "kN/m^3": 1e3}
ANGLE = {"deg": math.pi / 180.0, "rad": 1.0}
HEIGHTS = 12  # of faces that the law of model.toml tells apart
PART = 6  # of them in a part of the law
COLUMNS = ("plate", "motion", "alpha_x", "alpha_z")


@dataclass(frozen=True)
class Foot:
    """The foot, what it moves in, and how fast."""

    shape: str = param("disc", "", "of the foot; an STL file in its place", choices=("disc", "cone", "sphere", "box"))
    radius: float = param(0.0381, "m", "of disc, cone and sphere", lo=1e-5, hi=10)
    height: float = param(0.01, "m", "of disc, cone and box", lo=1e-6, hi=10)
    length: float = param(0.06, "m", "of the box along the tilt", lo=1e-5, hi=10)
    width: float = param(0.06, "m", "of the box across", lo=1e-5, hi=10)
    unit: str = param("mm", "", "of the STL file, which states none", choices=tuple(UNITS))
    law: str = param("3d", "", "Agarwal 2023, or Li 2013 in the plane of each normal", choices=("3d", "2d"))
    scale: float = param(4.6e5, "N/m^3", "stress per depth of a plate that goes down", lo=0, hi=1e9, open_lo=True)
    friction: float = param(0.4, "", "of the foot's surface, under the law 3d", lo=0, hi=5)
    density: float = param(570.0, "kg/m^3", "of the bed, for the inertia", lo=0, hi=2e4)
    inertia: float = param(1.1, "", "factor of density v_n^2; 0: quasistatic", lo=0, hi=20)
    speed: float = param(0.0, "m/s", "of the foot; 0: slow", lo=0, hi=100)
    rise: float = param(0.0, "m", "of the surface at the foot above the undisturbed one", lo=-1, hi=1)


def checked(table: Mapping[str, object]) -> Foot:
    """The foot of keywords. InputError with every value out of range."""
    made, problems = read(Foot, table, "rft")
    if problems:
        raise InputError(problems)
    foot: Foot = made
    return foot


def body(foot: Foot, stl: Path | None) -> Array:
    """Its triangles, cut to be fine."""
    if stl is not None:
        try:
            made = shapes.read_stl(stl, UNITS[foot.unit])
        except (OSError, ValueError) as e:
            raise InputError([f"rft --stl {e}" if str(stl) in str(e) else f"rft --stl {stl}: {e}"]) from None
    elif foot.shape == "box":
        made = shapes.box(foot.length, foot.width, foot.height)
    elif foot.shape == "sphere":
        made = shapes.sphere(foot.radius)
    else:
        made = {"disc": shapes.disc, "cone": shapes.cone}[foot.shape](foot.radius, foot.height)
    # twenty triangles along the greatest extent of the foot
    return cut(made, float(np.ptp(made.reshape(-1, 3), axis=0).max()) / 20.0)


def read_table(path: Path) -> Table:
    """Stresses from a CSV of columns plate, motion, alpha_x, alpha_z, each with its unit: `alpha_z [N/cm^3]`.

    plate: angle of the plate to the horizontal, motion: of its motion below the horizontal; alpha_x against the motion,
    alpha_z upwards, per depth. InputError that names the file, the column and what is allowed.
    """
    found, _ = read_columns(path, {n: ANGLE if n in COLUMNS[:2] else STRESS for n in COLUMNS})
    limit = 0.5 * math.pi + 1e-6
    for name in COLUMNS[:2]:
        if found[name].size and np.abs(found[name]).max() > limit:
            raise InputError([f"{path}: column {name}: angles must be within -90 and 90 degrees"])
    try:
        return gridded(*(found[name] for name in COLUMNS))
    except ValueError as e:
        raise InputError([f"{path}: {e}"]) from None


def axis(name: str, text: str, low: float, high: float, unit: str) -> Array:
    """Values (n,) of LO:HI:N, or of one value. InputError for what is neither, or out of range."""
    parts = text.split(":")
    try:
        ends = [float(x) for x in parts[:2]]
        count = int(parts[2]) if len(parts) == 3 else 1
    except ValueError:
        ends, count = [], 0
    if len(parts) not in (1, 3) or not 1 <= count <= 10_000:
        raise InputError([f"rft --{name} {text}: must be LO:HI:N with N in [1, 10000], or one value, in {unit}"])
    if not all(low <= x <= high for x in ends):
        raise InputError([f"rft --{name} {text}: must lie in [{low:g}, {high:g}] {unit}"])
    return np.linspace(ends[0], ends[-1], count)


def grains_of(foot: Foot, table: Table | None) -> Grains:
    """What it moves in; a table's stresses need no scale, and those of plates hold their plates' friction."""
    more = foot.density, foot.inertia, foot.rise
    if table is not None:
        return Grains(1.0, math.inf, *more, of_plane(table.__call__))
    if foot.law == "2d":
        return Grains(foot.scale, math.inf, *more, of_plane(generic_2d))
    return Grains(foot.scale, foot.friction, *more, generic_3d)


def forces(foot: Foot, triangles: Array, grains: Grains, depth: Array, tilt: Array, attack: Array) -> pd.DataFrame:
    """A row a tilt [deg], attack [deg below the horizontal] and depth of the lowest point [m]: force and torque.

    The torque is about the point of the foot's axis x = y = 0 at the depth of the lowest one.
    """
    rows = []
    speed = max(foot.speed, 1e-9)
    for angle in watch(tilt, "tilts"):
        standing = shapes.tilted(triangles, math.radians(float(angle)))
        for way in attack:
            go = math.radians(float(way))
            v = speed * np.array([math.cos(go), 0.0, -math.sin(go)])
            for z in depth:
                at = np.array([0.0, 0.0, -float(z)])
                p = push(standing + at, v, grains=grains, about=at)
                rows.append((float(angle), float(way), float(z), *p.force, *p.torque))
    names = ["tilt_deg", "attack_deg", "depth_m", *(f"F{k}_N" for k in "xyz"), *(f"T{k}_Nm" for k in "xyz")]
    return pd.DataFrame(rows, columns=names)


def profile_of(foot: Foot, triangles: Array, grains: Grains, tilt: float) -> Profile:
    """Of the foot at a tilt [deg] that goes straight down; with the drag of v^2 whatever its speed."""
    standing = shapes.tilted(triangles, math.radians(tilt))
    return profile(standing, grains=replace(grains, inertia=foot.inertia, density=foot.density), heights=HEIGHTS)


def ground_law(found: Profile, grains: Grains, comment: str) -> str:
    """model.toml: the foot as the ground of simulate, sweep and plan; a level body that goes straight down."""
    height = float(found.height[-1])
    terms = [
        f"{s:.8g} * maximum(z - {h / height:.8g} * height, 0)" if h else f"{s:.8g} * z"
        for h, s in zip(found.height.tolist(), found.share.tolist())
    ]
    parts = {f"part_{i}": " + ".join(terms[k : k + PART]) for i, k in enumerate(range(0, len(terms), PART))}
    own = '"rft_foot", "inertial_drag"' if found.drag > 0.0 else '"rft_foot"'
    lines = [f"# {comment}", "[model]", f"terms = [{own}]"]
    lines += [f"alpha = {found.drag!r}  # kg/m: of v^2, all of the foot in the grains"] if found.drag > 0.0 else []
    lines += ["", "[mechanism.rft_foot]", 'acts_on = "static"', f'law = "scale * area * ({" + ".join(parts)})"']
    lines += ['words = "resistive force theory of the foot"', 'source = "docs/rft.md"']
    lines += ["", "[mechanism.rft_foot.let]", *(f'{n} = "{text}"' for n, text in parts.items())]
    values = [("scale", "N/m^3", grains.scale), ("area", "m^2", found.area)]
    for name, unit, value in [*values, *([("height", "m", height)] if height else [])]:
        lines += ["", f"[mechanism.rft_foot.parameters.{name}]", f'unit = "{unit}"', f"start = {value!r}"]
        lines += [f"range = [0.0, {20.0 * value!r}]"] if name == "scale" else []  # the others are the foot's own
    return "\n".join(lines) + "\n"


def plate_stress(grains: Grains, theta: float) -> float:
    """sigma_z [N/m^3]: vertical stress per depth on a plate at theta [rad] to the horizontal that goes down, slowly.

    On the mantle of a cone with this angle it is that of thesis eq. (27).
    """
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [math.cos(theta), 0.5, math.sin(theta)]])
    slow = replace(grains, inertia=0.0, rise=0.0)
    p = push([corners - [0.0, 0.0, 1.0 + corners[:, 2].mean()]], (0.0, 0.0, -1.0), grains=slow)
    return float(p.traction[0, 2])


@dataclass(frozen=True)
class FootNumbers:
    """The foot in a few numbers: going straight down, level, its force over depth [N/m], that over its shadow [N/m^3].

    sigma_cone: vertical stress per depth on the mantle of a cone of 60 degrees that goes down, for the model rft_cone.
    """

    triangles: int
    extent_m: list[float]
    area_m2: float
    slope_N_m: float | None
    stress_N_m3: float | None
    sigma_cone_N_m3: float


def numbers(triangles: Array, found: pd.DataFrame, grains: Grains) -> FootNumbers:
    """Of the foot going straight down without tilt; None where that was not asked for."""
    points = triangles.reshape(-1, 3)
    both = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    shadow = 0.25 * float(np.abs(both[:, 2]).sum())  # of a closed body: up and down count once each
    level = found[(found.tilt_deg == 0.0) & (found.attack_deg == 90.0) & (found.depth_m > 0.0)]
    slope = float(level.Fz_N.iloc[-1] / level.depth_m.iloc[-1]) if len(level) else None
    extent = [float(x) for x in np.ptp(points, axis=0)]
    return FootNumbers(
        len(triangles),
        extent,
        shadow,
        slope,
        slope / shadow if slope is not None else None,
        plate_stress(grains, math.pi / 3),
    )


def write_forces(found: pd.DataFrame, facts: Mapping[str, object], inputs: Sequence[Path], folder: Path) -> list[Path]:
    """rft.csv and rft.json, each in one step."""
    files = [folder / "rft.csv", folder / "rft.json"]
    write_aside(files[0], found.to_csv(index=False, lineterminator="\n"))
    read_from = {str(f): sha256(f) for f in inputs}
    write_aside(files[1], json.dumps(plain({**facts, "versions": versions(), "inputs": read_from}), indent=1) + "\n")
    return files


def facts_of(foot: Foot, table: Path | None, stl: Path | None, found: FootNumbers, command: str) -> dict[str, object]:
    """What rft.json says."""
    law = f"table {table}" if table else {"3d": "Agarwal et al. 2023", "2d": "Li et al. 2013"}[foot.law]
    return {"command": command, "foot": asdict(foot) | {"stl": stl and str(stl)}, "law": law, "numbers": asdict(found)}
