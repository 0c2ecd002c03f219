"""Jumps at every point of a grid of axes, over the cores: a data set whose dimensions are named as the axes."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.base.progress import watch
from jumpvision.base.record import RecordError, plain
from jumpvision.base.schema import InputError, closest
from jumpvision.base.storage import in_one_step
from jumpvision.base.threads import at_most
from jumpvision.experiment.results.fields import as_attributes, attributes_of
from jumpvision.experiment.workflow.entries import versions
from jumpvision.jumper.physics.batch import BY_AREA, hard_points, resolve, simulated_points
from jumpvision.jumper.physics.hard.jump import RESULTS as COMPUTED
from jumpvision.jumper.physics.model import GROUNDS
from jumpvision.jumper.physics.oscillator import natural_frequency
from jumpvision.jumper.physics.packing import Laws

from .axes import AXES, Value, option, read_axes
from .robot import Say, Setup, Tables, setup_of

CHUNK = 200_000  # points of an exact sweep in memory at once
SMALL = 2000  # points of an integrated one
RTOL, ATOL = 1e-6, 1e-9  # as the stage `simulate`
GRID = {"frequency": (0.2, 1.8, 320), "phase": (0.0, 2.0 * np.pi, 241)}  # f_0 and rad: where no range is asked for
SLOW_GRID = {"frequency": (0.35, 1.5, 40), "phase": (0.0, 2.0 * np.pi, 25)}  # where a jump takes half a millisecond


def sweep(
    ground: str,
    axes: Mapping[str, Value],
    *,
    experiment: Path | None = None,
    model: Path | None = None,
    laws: Laws | None = None,
    overrides: Tables | None = None,
    workers: int = 1,
    say: Say = print,
) -> xr.Dataset:
    """Jumps over any axes (`axes.read_axes`); over frequency and phase where no axis is a range.

    The robot is that of an experiment.toml, else the thesis'; model: a file whose [model] replaces its own; laws: of
    the bed's parameters against its volume fraction; overrides: values by section that replace theirs.
    Returns RESULTS and jump_class over the axes that have several values. InputError names every problem.
    """
    if ground not in GROUNDS:
        raise InputError([f"sweep {ground}: unknown ground{closest(ground, GROUNDS)}"])
    if ground == "hard" and laws is not None:
        raise InputError([f"--laws {laws.source}: has no meaning on hard ground; leave it out"])
    given, values = read_axes(ground, axes), dict(overrides or {})
    laws = laws.without(values.get("model", {})) if laws else None
    setup = setup_of(ground, experiment, values, model_file=model, laws=laws if laws and laws.laws else None)
    f0 = natural_frequency(setup.values["stiffness"], setup.values["motor_mass"] + setup.values["rod_mass"])
    if not any(a.ndim for a in given.values()):
        usual = GRID if setup.exact else SLOW_GRID
        ranges = {n: np.linspace(*x) * (f0 if n == "frequency" else 1.0) for n, x in usual.items()}
        given |= {n: x for n, x in ranges.items() if n not in given}
    results = grid_results(setup, given, workers=workers, say=say)
    if failed := int(np.isnan(results["com_height_m"]).sum()):
        say(f"warning: {failed} of {results['com_height_m'].size} motions could not be followed; they are NaN")
    return dataset(setup, given, results, f0)


def highest(data: xr.Dataset) -> str:
    """Where the centre of mass rises highest, in words."""
    height = data.com_height_m
    if not bool(np.isfinite(height).any()):
        return "none of the motions could be followed"
    at = height.isel(height.argmax(...)) if height.dims else height
    return f"{float(at) * 1e3:.2f} mm" + "".join(f", {n} {float(at[n]):.4g}" for n in height.dims)


def grid_results(setup: Setup, given: Mapping[str, Array], *, workers: int, say: Say) -> dict[str, AnyArray]:
    """Results over the grid of `given`: shape the sizes of its 1-D entries, in order. InputError for what cannot be."""
    no_effect(setup, given)
    shape = tuple(a.size for a in given.values() if a.ndim)
    total = math.prod(shape)
    out = {name: np.empty(total) for name in COMPUTED}

    def values(lo: int, hi: int) -> dict[str, Array]:
        at = iter(np.unravel_index(np.arange(lo, hi), shape) if shape else ())
        point = {n: a[next(at)] if a.ndim else np.full(hi - lo, float(a)) for n, a in given.items()}
        full = resolve(setup.values, point)
        if setup.laws:
            full |= setup.laws.points(full["phi"], setup.model.foot_radius or math.nan, setup.phi_sigma)
        return {n: np.ascontiguousarray(np.broadcast_to(v, (hi - lo,))) for n, v in full.items()}

    if setup.laws and (said := setup.laws.continued(given.get("phi", np.asarray(setup.values["phi"])))):
        say(said)
    try:
        values(0, 1)
        step = CHUNK if setup.exact else SMALL
        edges = [(lo, min(lo + step, total)) for lo in range(0, total, step)]
        for lo, hi in watch(edges, "jumps, chunks"):
            v = values(lo, hi)
            with at_most(workers):
                found = hard_points(v) if setup.exact else simulated_points(setup.model, v, rtol=RTOL, atol=ATOL)
            for name, column in found.items():
                out[name][lo:hi] = column
    except InputError:
        raise
    except ValueError as e:
        raise InputError([f"sweep {setup.model.ground}: {e}"]) from None
    return {n: v.reshape(shape) for n, v in out.items()}


def no_effect(setup: Setup, given: Mapping[str, Array]) -> None:
    """InputError for axes of the bed that the model's terms do not see: their map would be constant."""
    model = setup.model
    seen = {n for t in model.terms for n in model.mechanism(t).symbols}
    inert = {
        "phi": not setup.laws and (model.volume_fraction is None or "phi" not in seen),
        "foot_radius": model.foot_radius is None
        or not ("R" in seen or any(getattr(model.parameters, n) for n in BY_AREA)),
    }
    problems = [
        f"{option(n)}: has no effect in a model of {', '.join(model.terms) or 'hard ground'}; give [bed] "
        "volume_fraction, [robot] foot_radius and a model with depth_drag or added_mass, or --laws, or leave it out"
        for n, useless in inert.items()
        if n in given and useless
    ]
    if problems:
        raise InputError(problems)


FILE = "sweep.nc"
RESULTS = {  # name: unit, meaning (docs/physics.md section 1)
    "com_height_m": ("m", "greatest rise of the centre of mass above rest"),
    "flight_height_m": ("m", "g t_f^2 / 8 of the longest flight that ends after the forcing"),
    "jump_height_m": ("m", "greatest rod height after the motor stops, minus rest"),
    "n_jumps": ("1", "flights up to and including the first that ends after the forcing"),
    "lift_off_s": ("s", "first lift-off after the start of the law"),
    "peak_power_W": ("W", "greatest internal power F_m X_m' while the law runs, without impulses"),
    "peak_force_N": ("N", "greatest motor force F_m = m_m (a_m + g) while the law runs, without impulses"),
    "peak_motor_speed": ("m/s", "greatest |X_m'|"),
}
CLASSES = ("none", "single", "stutter", "multi_jump")


def jump_class(n_jumps: AnyArray) -> NDArray[np.int8]:
    """0 no jump, 1 single, 2 stutter (two jumps), 3 multi-jump: indices into CLASSES (thesis Figs 27, 28)."""
    return np.clip(np.nan_to_num(n_jumps), 0, 3).astype(np.int8)


def dataset(setup: Setup, given: Mapping[str, Array], results: Mapping[str, AnyArray], f0: float) -> xr.Dataset:
    """`results` over the axes `given`; f0: natural frequency [Hz], which the figure marks."""
    dims = tuple(n for n, a in given.items() if a.ndim)
    variables: dict[str, xr.Variable] = {}
    for name, (unit, meaning) in RESULTS.items():
        values = np.asarray(results[name])
        if name == "n_jumps":
            values = np.nan_to_num(values, nan=-1).astype(np.int64)
        variables[name] = xr.Variable(dims, values, {"units": unit, "long_name": meaning})
    flags = {"units": "1", "flag_values": np.arange(4, dtype=np.int8), "flag_meanings": " ".join(CLASSES)}
    variables["jump_class"] = xr.Variable(dims, jump_class(results["n_jumps"]), {**flags, "long_name": "kind of jump"})
    coords = {
        n: xr.Variable((n,) if a.ndim else (), a, {"units": AXES[n].unit or "1", "long_name": AXES[n].meaning})
        for n, a in given.items()
    }
    return xr.Dataset(variables, coords=coords, attrs=as_attributes(Origin.of(setup, "map", f0)))


@dataclass(frozen=True, kw_only=True)
class Origin:
    """What every sweep was made with, under the names of the attributes of its file.

    ground, robot, model, analysis, laws_source: in words. constants, laws, versions: JSON objects; the constants of
    robot and motor law are in SI, and an axis replaces its own. f0_Hz: natural frequency, None where not told.
    """

    ground: str
    robot: str
    constants: str
    model: str
    laws: str | None = None
    laws_source: str | None = None
    versions: str
    analysis: str
    f0_Hz: float | None = None

    @classmethod
    def of(cls, setup: Setup, analysis: str, f0_Hz: float | None = None) -> Origin:
        """Return the origin of a data set: the robot and the installed versions."""
        return cls(
            ground=setup.model.ground,
            robot=setup.name,
            constants=json.dumps(plain(dict(setup.values))),
            model=str(setup.model),
            laws=json.dumps(setup.laws.plain()) if setup.laws else None,
            laws_source=setup.laws.source if setup.laws else None,
            versions=json.dumps(versions()),
            analysis=analysis,
            f0_Hz=f0_Hz,
        )

    @property
    def values(self) -> Mapping[str, float]:
        """The constants by name [SI]."""
        found: dict[str, float] = json.loads(self.constants)
        return found


def origin_of(data: xr.Dataset) -> Origin:
    """What a sweep was made with. RecordError where its attributes do not say."""
    return attributes_of(Origin, data)


def write(data: xr.Dataset, folder: Path, file: str = FILE) -> Path:
    """Write the data set into a file of the folder, in one step."""
    packed = {n: {"zlib": True, "complevel": 1} for n, v in data.data_vars.items() if v.size > 1000}
    with in_one_step(folder / file) as aside:
        data.to_netcdf(aside, engine="netcdf4", encoding=packed)
    return folder / file


def keep_other(file: Path, data: xr.Dataset) -> Path | None:
    """Give the sweep that a file holds a name of its own where it is another than `data`; that name, None for none.

    A figure beside it goes with it. The same sweep made again, or what is no sweep, keeps the name and may be replaced.
    """
    try:
        with xr.open_dataset(file, engine="netcdf4") as other:
            name = own_name(other)
    except (OSError, ValueError, RecordError):
        return None
    if name == own_name(data):
        return None
    kept = file.with_name(f"{file.stem}-{name}.nc")
    if file.with_suffix(".png").exists():
        file.with_suffix(".png").replace(kept.with_suffix(".png"))
    file.replace(kept)
    return kept


def own_name(data: xr.Dataset) -> str:
    """What tells a sweep from others: analysis, axes, and six digits of a digest of their values and all constants."""
    origin = origin_of(data)
    axes = [str(d) for d in data.dims if str(d) in AXES]
    parts = [origin.ground, origin.robot, origin.constants, origin.model, origin.laws, origin.analysis]
    parts += [f"{n} {np.asarray(v.values).tolist()}" for n, v in sorted(data.coords.items(), key=lambda c: str(c[0]))]
    return "-".join([origin.analysis, *axes, hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()[:6]])
