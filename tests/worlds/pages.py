"""Campaigns with results as the stages write them, for whoever draws and shows them."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pandas as pd
import xarray as xr
from diagnosis_sample import confirmation, diagnosis

from jumpvision.base.storage import write_aside
from jumpvision.engine.document.values import Baseline, Cause, Cell, Gain, Height, Noise, NoiseSource, Parameter
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.experiment.results.fields import Column, ColumnGeometry
from jumpvision.experiment.results.summary import Summary
from jumpvision.experiment.workflow.run import Outcome
from jumpvision.report.figures.overlays import webm

KINDS = {"single": (0.040, 0.042), "stutter": (0.020, 0.034)}  # measured and simulated height [m]
SENTENCE = "The simulation over-predicts stutter jumps by 14.0 ± 0.1 mm because it lacks: added mass."


def png(shape=(90, 120), seed=0) -> bytes:
    noise = np.random.default_rng(seed).integers(0, 255, (*shape, 3), np.uint8)
    return cv2.imencode(".png", noise)[1].tobytes()


def film() -> bytes:
    """Ten frames of a bright square that moves right."""
    frames = np.zeros((10, 64, 96, 3), np.uint8)
    for k, f in enumerate(frames):
        f[20:40, 8 * k : 8 * k + 20] = (40, 120, 250)
    return webm(frames, rate=5.0)


def campaign_of(folder, n=4, picture=None):
    """A campaign of n jumps with the results of its stages as files; (campaign, outcomes, results)."""
    (folder / "bed").mkdir(parents=True)
    outcomes, results = [], folder / "results"
    for k in range(n):
        kind = list(KINDS)[k % 2]
        name, f = f"{kind}-{k}", 6.0 + 0.5 * (k // 2)
        home = folder / "bed" / name
        home.mkdir()
        (home / "experiment.toml").write_text(
            'schema = 1\nground = "hard"\n[actuation]\n'
            f'kind = "{kind}"\nfrequency = {f}\namplitude = 0.01\nstart = 0.1\ncycles = 1\n'
        )
        out = results / name
        out.mkdir(parents=True)
        t = np.arange(200) * 5e-3
        measured, model = KINDS[kind]
        rod = pd.DataFrame({"time_s": t, "height_m": measured * np.sin(6 * t), "sigma_m": 2e-5})
        rod.to_csv(out / "rod.csv", index=False)
        columns = {
            "time_s": t,
            "rod_m": 0.5 + model * np.sin(6 * t),
            "foot_m": 0.0,
            "motor_m": 0.6,
            "ground_N": 0.0,
            "spring_N": 0.0,
        }
        pd.DataFrame(columns).to_csv(out / "simulation.csv", index=False)
        summary = {
            "experiment": name,
            "kind": kind,
            "jump_height_m": measured,
            "sigma_m": 2e-5,
            "simulated_height_m": model,
        }
        (out / "summary.json").write_text(json.dumps(summary))
        write_aside(out / "provenance.json", json.dumps({"command": "jumpvision run", "outputs": {"rod.csv": name}}))
        if picture:
            (out / "track.png").write_bytes(picture)
        outcomes.append(Outcome(name, out, summary=Summary.of(summary)))
    return open_campaign(folder / "bed"), outcomes, results


def grains_into(out):
    """Grain results of a cone of slope 2 under a foot of 38.1 mm, as the stages write them."""
    t = np.arange(12) * 2e-3
    x, y = np.arange(-30, 31, 4) * 1e-3, np.arange(-70, 1, 4) * 1e-3
    depth, mass = 2.5e-3 * np.arange(12), 0.005 * np.arange(12)
    shape = ("y", "x", "t")
    blank = np.zeros((y.size, x.size, t.size))
    zero = 0.0 * mass
    sigma = zero + 1e-3
    over_t = {"momentum": 0.4 * mass, "momentum_sigma": sigma, "added_mass": mass, "added_mass_sigma": sigma,
              "foot_depth": depth, "foot_speed": zero + 0.4}  # fmt: skip
    flow = xr.Dataset({k: ("t", v) for k, v in over_t.items()} | {"shear_rate": (shape, blank + 5.0)},
                      coords={"x": x, "y": y, "t": t})  # fmt: skip
    flow.to_netcdf(out / "flow.nc")
    piv = xr.Dataset({"u": (shape, blank), "v": (shape, blank - 0.3), "chc": (shape, blank + 1.0)}, coords=flow.coords)
    piv.to_netcdf(out / "piv.nc")
    places = {
        f"{n}_{w}": (("y", "t"), np.full((y.size, t.size), np.nan))
        for n in ("ridge", "outline")
        for w in ("left", "right")
    }
    named = ("max_speed", "log_a", "b", "beta_deg", "beta_deg_sigma", "theta_deg_sigma", "theta_bands_deg_sigma")
    fronts = {"jammed_thickness": 2.0 * depth, "jammed_thickness_sigma": zero + 5e-4, "theta_deg": zero + 60.0,
              "theta_bands_deg": zero + 62.0, "cone_radius": zero + 0.0381}  # fmt: skip
    below = -y[:, None] - depth
    column = xr.Dataset(
        {**places, **{k: ("t", v) for k, v in (fronts | {k: np.ones(12) for k in named}).items()},
         "depth": (("y", "t"), below), "speed": (("y", "t"), np.exp(-np.abs(below))),
         "speed_sigma": (("y", "t"), np.full_like(below, 0.01)), "foot_depth": ("t", depth)},
        coords={"y": y, "t": t},
    )  # fmt: skip
    Column.of(column, ColumnGeometry(0.9, 0.008, 0.005, 0.001, 1e-3, 0.0381, 0.05)).save(out)
    fit = {"sigma": 0.01, "unit": "", "n": 12, "chi2": 1.0}
    fits = {"mu": 2.0, "mu_intercept_m": 0.0, "cone_slope_kg_m": 2.0, "mu_over_tan_theta": 0.5, "C": 2.7}
    (out / "fits.json").write_text(json.dumps({k: {"value": v, **fit} for k, v in fits.items()}))
    for name in ("piv.webm", "cone.webm"):
        (out / name).write_bytes(film())


def diagnosis_of(rows):
    """One that names the added mass."""
    heights = []
    for r in rows:
        height, simulated = r.summary.jump_height.value, r.summary.simulated_height
        heights.append(Height(r.experiment, r.kind, 6.0, 0.0, None, height, 2e-5, simulated, height + 1e-4))
    sources = {"stated": None, "rest": NoiseSource(5e-5, 0.02, 950), "flight": None, "repeats": None}
    return diagnosis(
        sentence=SENTENCE,
        heights=tuple(heights),
        named=("added_mass",),
        noise=Noise(5e-5, 0.0, None, 0.0, 950, sources, {}, {}, (), ()),
        confirmation=(confirmation("C", (2.6, 0.1), (2.7, 0.2), source="film stutter-1"),),
        baseline=Baseline((), {}, 0.0099, 0.008, 900.0),
        where=(Cell("stutter", "landing", -0.006, 9.0, 1e-5, 40), Cell("single", "flight", 0.001, 9.0, 0.3, 40)),
        causes=(Cause("added_mass", (), 0.97, (0.9, 0.99), 812.3, {"C": Parameter(2.7, 2.4, 3.0, "1")}),),
        gain=Gain(tuple(h.experiment for h in heights), 0.0099, 0.0003, 0.008, 0.0002, 43.0, (34.0, 53.0), True),
    )
