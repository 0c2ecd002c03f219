"""Contradictions planted into folders of the virtual laboratory: are the numbers right all the same, or is it told?

Each draw is a world of its own (ground, jump, noise that the analysis does not model, a motor with a loop or without)
and a slip of a drawn size. `python -m benchmarks.fuzz contradictions [first seed] [draws]`.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import shutil
import tempfile
import time
import tomllib
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import tomlkit

from jumpvision.base.schema import InputError
from jumpvision.cli import main as jumpvision
from jumpvision.experiment.campaign.folder import as_campaign, warnings_of
from jumpvision.experiment.inputs.experiment import open_folder
from jumpvision.experiment.stages.bed.geometry import check_geometry
from jumpvision.experiment.stages.preflight import preflight
from jumpvision.laboratory.campaign import write_campaign

Rng = np.random.Generator
SIGMAS = 4.0  # by which a number of a right folder may differ from the healthy one's
MODEL = 0.02  # of the simulated height


def world(rng: Rng, ground: str, *, filmed: bool = False) -> str:
    """A protocol of one jump."""
    hard = ground == "hard"
    kind = str(rng.choice(["single", "stutter", "delayed_stutter"]))
    frequency = rng.uniform(8.0, 12.0) if hard else rng.uniform(5.5, 9.0)
    amplitude = rng.uniform(0.003, 0.005) if hard else rng.uniform(0.014, 0.02)
    rate = float(rng.choice([200.0, 250.0, 500.0, 1000.0]))
    family = str(rng.choice(["white", "t3", "outliers"]))
    noise, rho, drift = 10 ** rng.uniform(-5.0, -4.2), rng.uniform(0.0, 0.5), rng.uniform(0.0, 5e-5)
    loop = "[motor]\nkp = 20000.0\nkd = 120.0\nmax_force = 100.0\n" if rng.random() < 0.5 else ""
    delay = f"delay = {rng.uniform(0.05, 0.15):.3f}\n" if kind == "delayed_stutter" else ""
    robot = (
        "motor_mass = 1.003\nrod_mass = 0.175\nspring_stiffness = 5760.6\nspring_damping = 1.37\n"
        if hard
        else "motor_mass = 1.125\nrod_mass = 0.175\nfoot_mass = 0.04\nspring_stiffness = 3300.0\nspring_damping = 1.2\n"
    )
    truth = (
        "[truth]\nterms = []\n[model]\nterms = []\n"
        if hard
        else f"[truth]\nterms = ['two_resistance', 'inertial_drag']\nk1 = {rng.uniform(1800.0, 3000.0):.0f}\n"
        f"k2 = 1800.0\ndelta = 0.012\nalpha = {rng.uniform(40.0, 100.0):.0f}\n"
    )
    values = {line.split(" = ")[0]: line for line in truth.splitlines() if " = " in line}
    model = "" if hard else "[model]\n" + "\n".join(values.values()) + "\n"
    track = (
        f"rod_track = {{ rate = {rate}, noise = {noise:.3g}, rho = {rho:.2f}, family = '{family}', "
        f"drift = {drift:.2g} }}"
    )
    film = "rod_film = { file = 'rod', rate = 200.0, exposure = 0.002 }" if filmed else track
    return (
        f"name = 'a world'\nground = '{ground}'\nduration = {0.8 if filmed else 1.6}\nstart = 0.2\n"
        f"[robot]\n{robot}{loop}{truth}"
        f"[[jumps]]\nkind = '{kind}'\nfrequency = {frequency:.3f}\namplitude = {amplitude:.4f}\n{delay}"
        f"[record]\n{film}\nmotor_log = {{}}\ncontact_log = {{}}\n{model}"
    )


def draw(place: Path, rng: Rng, *, ground: str | None = None, filmed: bool = False) -> Path:
    """A campaign of one healthy experiment below `place`."""
    chosen = ground or str(rng.choice(["hard", "granular"]))
    protocol = place / "protocol.toml"
    protocol.parent.mkdir(parents=True, exist_ok=True)
    protocol.write_text(world(rng, chosen, filmed=filmed))
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        write_campaign(protocol, place / "c", seed=int(rng.integers(2**31)))
    for truth in (place / "c").rglob("truth.json"):
        truth.unlink()
    return place / "c"


def experiment_of(campaign: Path) -> Path:
    return next(f.parent for f in campaign.glob("*/experiment.toml"))


def edit(folder: Path, section: str, **values: object) -> None:
    """Keys of a section, of the experiment's own file where it has the section, else of the campaign's."""
    own, shared = folder / "experiment.toml", folder.parent / "campaign.toml"
    file = own if section in tomllib.loads(own.read_text()) or not shared.exists() else shared
    document = tomlkit.parse(file.read_text())
    document.setdefault(section, tomlkit.table()).update(values)
    file.write_text(tomlkit.dumps(document))


def value(folder: Path, section: str, key: str) -> float:
    """As the folder declares it."""
    for file in (folder / "experiment.toml", folder.parent / "campaign.toml"):
        if file.exists() and key in (found := tomllib.loads(file.read_text()).get(section, {})):
            return float(found[key])
    raise KeyError(f"{section}.{key}")


def column(folder: Path, name: str, **changed: Callable[[pd.Series], pd.Series]) -> None:
    """A table with some of its columns changed."""
    table = pd.read_csv(folder / name, comment="#")
    table.assign(**{c: f(table[c]) for c, f in changed.items()}).to_csv(folder / name, index=False)


def either(rng: Rng, low: float, high: float) -> float:
    """A factor above 1 or its inverse, log-uniform."""
    return float(np.exp(rng.uniform(math.log(low), math.log(high)) * rng.choice([-1.0, 1.0])))


def scale(folder: Path, rng: Rng) -> str:
    off = 1.0 + rng.uniform(0.03, 0.3) * rng.choice([-1.0, 1.0])
    column(folder, "rod_track.csv", height_m=lambda h: off * h)
    return f"{100 * (off - 1):+.0f} %"


def half_rate(folder: Path, rng: Rng) -> str:
    """The film ran at half the frame rate that is stated: it seems to last half as long."""
    begin = rng.choice([0.0, 0.2])
    column(folder, "rod_track.csv", time_s=lambda t: begin + 0.5 * (t - begin))
    return f"about {begin:g} s"


def contact_in_ms(folder: Path, rng: Rng) -> str:
    column(folder, "contact.csv", time_s=lambda t: 1e3 * t)
    return ""


def polarity(folder: Path, rng: Rng) -> str:
    column(folder, "contact.csv", contact=lambda c: 1 - c)
    return ""


def upside_down(folder: Path, rng: Rng) -> str:
    column(folder, "rod_track.csv", height_m=lambda h: -h)
    return ""


def negated(folder: Path, rng: Rng) -> str:
    column(folder, "motor.csv", position_m=lambda x: -x)
    return ""


def spring_or_mass(folder: Path, rng: Rng) -> str:
    key, by = str(rng.choice(["spring_stiffness", "motor_mass"])), either(rng, 1.5, 10.0)
    edit(folder, "robot", **{key: value(folder, "robot", key) * by})
    return f"{key} x {by:.2f}"


def late(folder: Path, rng: Rng) -> str:
    by = rng.uniform(0.005, 0.05) * rng.choice([-1.0, 1.0])
    column(folder, "motor.csv", time_s=lambda t: t + by)
    return f"{1e3 * by:+.0f} ms"


def exposed(folder: Path, rng: Rng) -> str:
    exposure = float(rng.uniform(1.2, 20.0)) / value(folder, "rod_video", "frame_rate")
    edit(folder, "rod_video", exposure=exposure)
    return f"{1e3 * exposure:.0f} ms"


def density(folder: Path, rng: Rng) -> str:
    edit(folder, "bed", grain_density=round(float(rng.uniform(0.6, 3.0)), 2))
    return ""


def crater(folder: Path, rng: Rng, factor: float) -> str:
    """A map of a crater: a Gaussian with a rim and a slope, sensor noise."""
    size, step = float(rng.uniform(0.1, 0.5)), float(rng.uniform(1e-3, 4e-3))
    axis = np.arange(-size / 2, size / 2, step)
    r, wide = np.hypot(*np.meshgrid(axis, axis)), size * rng.uniform(0.1, 0.2)
    deep = rng.uniform(0.05, 0.4) * wide
    z = -deep * np.exp(-0.5 * (r / wide) ** 2) + 0.2 * deep * np.exp(-0.5 * ((r - 2 * wide) / (0.4 * wide)) ** 2)
    z += rng.normal(0.0, rng.uniform(1e-4, 1e-3), z.shape) + 0.01 * axis
    np.savez(folder / "crater.npz", z=factor * z)
    edit(folder, "crater_depth", file="crater.npz", scale=step)
    return f"{1e3 * deep:.1f} mm deep, {size:.2f} m wide"


def crater_in_mm(folder: Path, rng: Rng) -> str:
    return crater(folder, rng, 1e3)


def healthy_crater(folder: Path, rng: Rng) -> str:
    return crater(folder, rng, 1.0)


def copied(folder: Path, rng: Rng) -> str:
    target = folder.with_name("again")
    shutil.copytree(folder, target)
    return ""


Slip = Callable[[Path, Rng], str]
SLIPS: dict[str, tuple[Slip, dict[str, object]]] = {
    "scale off by 3 to 30 %": (scale, {}),
    "film at half the stated frame rate": (half_rate, {}),
    "contact log in ms": (contact_in_ms, {}),
    "contact log with 0 and 1 exchanged": (polarity, {}),
    "track with y down": (upside_down, {}),
    "motor log negated": (negated, {}),
    "k or m wrong by 1.5 to 10 times": (spring_or_mass, {}),
    "motor log shifted by 5 to 50 ms": (late, {}),
    "exposure above the frame interval": (exposed, {"filmed": True}),
    "density in g/cm^3": (density, {"ground": "granular"}),
    "crater map in mm": (crater_in_mm, {"ground": "granular"}),
    "the same recording twice": (copied, {}),
}


def told(campaign: Path) -> set[tuple[str, str]] | None:
    """(kind, recording) of every warning of `check`; None where it is refused."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            opened = as_campaign(open_folder(campaign))
            of = {e.name: preflight(e) for e in opened.experiments}
        except InputError:
            return None
        if any(problems for problems, _ in of.values()):
            return None
        said = {e.name: [*of[e.name][1], *check_geometry(e)[1]] for e in opened.experiments}
        return {(str(w["kind"]), str(w["recording"])) for w in warnings_of(opened, said)}


def numbers(campaign: Path, results: Path) -> dict[str, float | None]:
    """summary.json of the only experiment."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        jumpvision(["summary", str(campaign), "--results", str(results), "--no-pictures", "--workers", "1"])
    found = next(results.glob("*/summary.json"), None)
    return {} if found is None else json.loads(found.read_text())


def right(campaign: Path, healthy: Path, place: Path) -> bool:
    """Whether the numbers of both folders agree within their uncertainties."""
    a, b = numbers(campaign, place / "ra"), numbers(healthy, place / "rb")
    if a.keys() != b.keys() or not a:
        return False
    for key in ("jump_height_m", "flight_height_m", "flight_time_s", "lift_off_s", "frequency_hz", "zeta"):
        sigma = "sigma_m" if key == "jump_height_m" else f"{key}_sigma"
        if (a[key] is None) != (b[key] is None):
            return False
        if a[key] is not None and abs(a[key] - b[key]) > SIGMAS * math.hypot(a[sigma] or 0.0, b[sigma] or 0.0):
            return False
    x, y = a["simulated_height_m"], b["simulated_height_m"]
    return (x is None) == (y is None) and (x is None or abs(x - y) < MODEL * abs(y))


Drawn = tuple[str, int, str, str, str]


def planted(seed: int) -> list[Drawn]:
    """(slip, seed, size, "told" | "right" | "silent", what the healthy folder is told) of one draw of every slip."""
    return [_planted(seed, n, name, *SLIPS[name]) for n, name in enumerate(SLIPS)]


def _planted(seed: int, n: int, name: str, slip: Slip, kind: dict[str, object]) -> Drawn:
    rng = np.random.default_rng([seed, n])
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        healthy = draw(place / "healthy", rng, **kind)  # type: ignore[arg-type]
        if slip is crater_in_mm:
            healthy_crater(experiment_of(healthy), np.random.default_rng(seed))
        before = told(healthy)
        bad = shutil.copytree(healthy, place / "bad" / "c")
        size = slip(experiment_of(bad), np.random.default_rng(seed) if slip is crater_in_mm else rng)
        after = told(bad)
        if after is None or (before is not None and after - before):
            verdict = "told"
        else:
            verdict = "right" if right(bad, healthy, place) else "silent"
        said = "refused" if before is None else ", ".join(sorted(f"{k} {r}" for k, r in before))
        return name, seed, size, verdict, said


def table(first: int = 0, draws: int = 20, processes: int = 2) -> None:
    """Print the table, the worst row first; above it each silent draw and each healthy folder that is doubted."""
    began = time.perf_counter()
    rows: dict[str, list[Drawn]] = {name: [] for name in SLIPS}
    with ProcessPoolExecutor(processes) as pool:
        for drawn in pool.map(planted, range(first, first + draws)):
            for d in drawn:
                name, seed, size, verdict, said = d
                rows[name].append(d)
                if verdict == "silent" or said:
                    print(f"  {name}, seed {seed}, {size}: {verdict}{'; healthy: ' + said if said else ''}", flush=True)
    print("| contradiction | draws | told | right all the same | silent |\n|---|---|---|---|---|")
    count = {n: [sum(d[3] == k for d in of) for k in ("told", "right", "silent")] for n, of in rows.items()}
    for name in sorted(rows, key=lambda n: -count[n][2]):
        print(f"| {name} | {len(rows[name])} | {' | '.join(map(str, count[name]))} |")
    total = sum(map(len, rows.values()))
    silent, false = sum(c[2] for c in count.values()), sum(bool(d[4]) for of in rows.values() for d in of)
    good = 100.0 * (1.0 - silent / total)
    print(f"\nright or told {good:.1f} % of {total}; healthy worlds doubted: {false} of {total}")
    print(f"{time.perf_counter() - began:.0f} s")


FILM = "[grain_video]\nfile = '{}'\nscale = 1e-4\n"
BALL = "[rod_video]\nfile = '{}'\nscale = 1e-4\nball_diameter = 0.0126\nexposure = 2e-5\n"
KINECT = "ground = 'granular'\n[crater_depth]\nfile = '{}'\nscale = 0.0028025\nheight_scale = 0.001\n"
REAL = {  # real recordings: an experiment.toml, and what their sources say that is odd about them
    "photron_ball_12bit/ball_12bit.cihx": (BALL, None),
    "photron_beam/beam.cihx": (FILM, "only every 2500th frame was saved"),
    "photron_save_step/data_showcase.cih": (FILM, "only every 100th frame was saved"),
    "cine_pims/cine_781.cine": (FILM, "frames left out when it was saved?"),
    "cine_pims/cine_legacy.cine": (FILM, None),
    "norpix_pims/sample_norpix6.seq": (FILM, None),
    "pivlab_karman/*.bmp": (FILM + "frame_rate = 100.0\n", None),
    "trackpy_bulkwater/*.png": (FILM + "frame_rate = 100.0\n", None),
    "craters_kinect/[cf]*.npz": (KINECT, None),
    "craters_kinect/plane*.npz": (KINECT, "no crater"),
}


def healthy() -> None:
    """Print which folders of data_samples, and of the real recordings that JUMPVISION_REAL_DATA names, are doubted."""
    samples = [as_campaign(open_folder(Path("data_samples") / n)) for n in ("loose_sand", "hard_ground")]
    asked = [(e, None) for campaign in samples for e in campaign.experiments]
    doubted, real = [], os.environ.get("JUMPVISION_REAL_DATA")
    with tempfile.TemporaryDirectory() as place:
        for pattern, (toml, odd) in REAL.items() if real else ():
            found = sorted(Path(real).glob(pattern))
            if toml.startswith(FILM) and "*" in pattern:
                found = [found[0].with_stem("*")]  # one film
            for file in found:
                folder = Path(place) / pattern.replace("/", "-").replace("*", "all") / file.stem.replace("*", "all")
                folder.mkdir(parents=True)
                (folder / "real").symlink_to(file.parent.resolve())
                (folder / "experiment.toml").write_text(toml.format(f"real/{file.name}"))
                asked.append((as_campaign(open_folder(folder)).experiments[0], odd))
        for e, odd in asked:
            problems, warned = preflight(e)
            said = [*problems, *(w["message"] for w in warned)]
            if [odd in s for s in said] != [True] if odd else said:
                doubted.append(f"  {e.name}: {'; '.join(said) or f'not told: {odd}'}")
    print(*doubted, sep="\n")
    odd_ones = sum(odd is not None for _, odd in asked)
    print(f"healthy folders doubted: {len(doubted)} of {len(asked)}, {odd_ones} of which are odd, and told to be")
