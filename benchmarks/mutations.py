"""Tests that would notice: faults of the kinds that people make, one at a time, in a copy of the tree.

`python -m benchmarks.mutations [--wing WING] [--only NAME ...] [--list] [--jobs N] [--copy FOLDER]`

Each fault changes one expression of the physics to one that runs and is wrong: a sign, a factor, an axis, a unit, off
by one, a thing forgotten, names swapped, a term of an uncertainty dropped. Then the short run of the tests that should
notice (`-m 'not long'`, as by default) is made on it, without a fault first. Where the code has moved on, a fault says
what to look for, and the program fails. --copy keeps the copied tree, whose compiled code the next call finds again.
"""

from __future__ import annotations

import argparse
import ast
import functools
import math
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
COPIED = ("jumpvision", "tests", "data_samples", "docs", "pipelines", "benchmarks", "*.md", "*.toml", "*.cff")
SLOWER, LEAST = 4.0, 300.0  # times what the tests take without a fault, and s: a fault may recompile, or never end
COMPILED = re.compile(r"\bnumba\b|^@(?:law|shared|kernel|inlined)\b", re.MULTILINE)
FIRST = re.compile(r"^(?:FAILED|ERROR) (?:tests/)?(?:\w+/)*(\S+?)(?:\[.*)?(?: - .*)?$", re.MULTILINE)


class Fault(NamedTuple):
    """A fault. file: where the expression is, found by name; old, new: the expression, blanks of no account. tests:
    files that should notice, anywhere below tests/; select: which of their tests (`pytest -k`), where all take long."""

    name: str
    wing: str
    kind: str
    file: str
    old: str
    new: str
    tests: str
    select: str = ""


FAULTS = (
    Fault(
        "the end of an open range is allowed",
        "base",
        "off by one",
        "schema.py",
        'value <= meta["lo"] if meta["open_lo"] else value < meta["lo"]',
        'value < meta["lo"]',
        "test_schema.py",
    ),
    Fault(
        "digits of an uncertainty in another unit",
        "base",
        "unit",
        "arrays.py",
        'int(f"{sigma * factor:.1e}".partition("e")[2])',
        'int(f"{sigma:.1e}".partition("e")[2])',
        "test_report.py",
        "two_figures or without_uncertainty or words_units",
    ),
    Fault(
        "weighted mean counts its own freedom",
        "estimate",
        "off by one",
        "mean.py",
        "scatter_factor(chi2, n - 1) * float(w.sum()) ** -0.5, unit, n, chi2",
        "scatter_factor(chi2, n) * float(w.sum()) ** -0.5, unit, n, chi2",
        "test_mean.py",
    ),
    Fault(
        "jump height without the uncertainty of rest",
        "estimate",
        "dropped uncertainty",
        "height.py",
        "math.hypot(spread, rest_sigma),",
        "spread,",
        "test_fit_flight.py",
        "height or rise or rest",
    ),
    Fault(
        "flight time with the error of one edge",
        "estimate",
        "dropped uncertainty",
        "flights.py",
        "both = self.lift_off_sigma**2 + self.landing_sigma**2 - 2.0 * self.covariance",
        "both = self.landing_sigma**2",
        "test_fit_flight.py",
        "contact or edge or flight",
    ),
    Fault(
        "damping over the damped frequency",
        "estimate",
        "names swapped",
        "ringdown.py",
        "zeta=decay / omega0,",
        "zeta=decay / w,",
        "test_fit_ringdown.py",
    ),
    Fault(
        "two halves of a crater as if their scatter were known",
        "estimate",
        "dropped uncertainty",
        "crater.py",
        "math.sqrt(noise_sigma**2 + TWO_HALVES**2 * excess)",
        "math.sqrt(noise_sigma**2 + excess)",
        "test_crater.py",
        "volume_by_a_line or halves",
    ),
    Fault(
        "correlation time counts lag 0 once too often",
        "estimate",
        "off by one",
        "mean.py",
        "2.0 * np.cumsum(acf / acf[0]) - 1.0",
        "2.0 * np.cumsum(acf / acf[0])",
        "test_intrusion.py",
        "correlation_time",
    ),
    Fault(
        "one bed too few taken off the freedoms of a power law",
        "estimate",
        "off by one",
        "estimate.py",
        "dof = value.size - beds.size - 1",
        "dof = value.size - 1",
        "test_fit_line.py test_intrusion.py",
        "radius or laws_of_a_bed or foot_area",
    ),
    Fault(
        "critical packing without the error of phi",
        "estimate",
        "dropped uncertainty",
        "crater.py",
        "return float(np.sum((v - b * d) ** 2 / (dv**2 + (b * dphi) ** 2))), b",
        "return float(np.sum((v - b * d) ** 2 / dv**2)), b",
        "test_crater.py",
        "critical_packing_is_covered or errors_of",
    ),
    Fault(
        "frames left out when saving do not count",
        "films/frames",
        "forgotten",
        "mraw.py",
        "np.arange(n, dtype=np.float64) * (skip / rate)",
        "np.arange(n, dtype=np.float64) / rate",
        "test_frames_raw.py",
    ),
    Fault(
        "red taken for blue in grey",
        "films/frames",
        "names swapped",
        "base.py",
        "299 * red.astype(np.uint32) + 587 * green.astype(np.uint32) + 114 * blue.astype(np.uint32)",
        "114 * red.astype(np.uint32) + 587 * green.astype(np.uint32) + 299 * blue.astype(np.uint32)",
        "test_frames.py",
    ),
    Fault(
        "a declared clock begins at zero",
        "films/frames",
        "forgotten",
        "base.py",
        'return Clock(start + positions / frame_rate, "declared", warnings)',
        'return Clock(positions / frame_rate, "declared", warnings)',
        "test_frames.py",
    ),
    Fault(
        "exposure of a film in ms",
        "films/frames",
        "unit",
        "cine.py",
        "entry(setup, SHUTTER_NS) * 1e-9 or entry(setup, SHUTTER_US) * 1e-6",
        "entry(setup, SHUTTER_NS) * 1e-9 or entry(setup, SHUTTER_US) * 1e-3",
        "test_frames_raw.py",
    ),
    Fault(
        "noise of a disc's pixels without the fitted parameters",
        "films/vision",
        "off by one",
        "disc.py",
        "spent = (3.0, 3.0, 6.0 if streak else 4.0)",
        "spent = (0.0, 0.0, 0.0 if streak else 0.0)",
        "test_ball.py test_disc_sums.py",
        "sigma or error or noise",
    ),
    Fault(
        "a rail leans the other way",
        "films/vision",
        "sign",
        "camera.py",
        "turn = np.exp(1j * tilt)",
        "turn = np.exp(-1j * tilt)",
        "test_camera.py",
    ),
    Fault(
        "scale of marks as good whatever their number",
        "films/vision",
        "factor",
        "camera.py",
        "noise / float(np.sqrt(np.sum(np.abs(place - place.mean()) ** 2)))",
        "noise / float(np.sqrt(np.mean(np.abs(place - place.mean()) ** 2)))",
        "test_budget.py test_camera.py",
        "marks or clicks or scale",
    ),
    Fault(
        "PIV's limit of outliers ten times too wide",
        "films/vision",
        "factor",
        "engine.py",
        "normalised_median(good[0], good[1], _slopes(good, s.step), certain) > s.outlier",
        "normalised_median(good[0], good[1], _slopes(good, s.step), certain) > 10.0 * s.outlier",
        "test_piv.py",
        "torn or decorrelated or median or nan or reflection",
    ),
    Fault(
        "noise that the match takes out is not given back",
        "films/vision",
        "dropped uncertainty",
        "validate.py",
        "return float(np.sqrt(shift / left)), float(np.sqrt(slope / left))",
        "return float(np.sqrt(shift)), float(np.sqrt(slope))",
        "test_piv.py",
        "sigma_is_true or sigma_without or sigma_knows",
    ),
    Fault(
        "first guess of a displacement with axes swapped",
        "films/vision",
        "axis",
        "predict.py",
        "return at_vectors[..., 0], at_vectors[..., 1]",
        "return at_vectors[..., 1], at_vectors[..., 0]",
        "test_piv.py",
        "test_error or uniform or large",
    ),
    Fault(
        "phi from the width of the bed twice",
        "films/vision",
        "axis",
        "surface.py",
        "phi = solid_volume / (length * width * height)",
        "phi = solid_volume / (width * width * height)",
        "test_surface.py test_bed.py",
    ),
    Fault(
        "height of a bed without what all columns share",
        "films/vision",
        "dropped uncertainty",
        "surface.py",
        "float(middle), math.hypot(sigma, surface.common), math.atan(slope)",
        "float(middle), sigma, math.atan(slope)",
        "test_surface.py test_bed.py",
    ),
    Fault(
        "foot's face as sure as its picture is sharp",
        "films/vision",
        "dropped uncertainty",
        "foot_face.py",
        "math.hypot(FACE_OF_FOOT.value, body.offset_sigma)",
        "body.offset_sigma",
        "test_foot.py",
    ),
    Fault(
        "momentum without what was filled in under the face",
        "films/grains",
        "dropped uncertainty",
        "momentum.py",
        "sums.hole_variance + sums.drift**2 / 3.0 + sums.bridged**2 / 12.0",
        "sums.hole_variance + sums.drift**2 / 3.0",
        "test_field.py",
    ),
    Fault(
        "windows overlap along one axis alone",
        "films/grains",
        "axis",
        "gradients.py",
        "r = rho[abs(pi[k] - pi[m])] * rho[abs(pj[k] - pj[m])]",
        "r = rho[abs(pi[k] - pi[m])] * rho[abs(pi[k] - pi[m])]",
        "test_field.py",
        "stated_sigmas or independence",
    ),
    Fault(
        "decay below the foot without the error of the greatest speed",
        "films/grains",
        "dropped uncertainty",
        "column.py",
        "math.hypot(factor * math.sqrt(float(row @ cov @ row)), maximum_sigma / maximum / k)",
        "factor * math.sqrt(float(row @ cov @ row))",
        "test_fit_column.py",
    ),
    Fault(
        "noise of the matching counts as fluctuation",
        "films/grains",
        "forgotten",
        "steady.py",
        "uu - u_noise, vv - v_noise,",
        "uu, vv,",
        "test_steady.py",
    ),
    Fault(
        "contact angle against the vertical",
        "films/grains",
        "names swapped",
        "column.py",
        "return math.asin(q), q / math.sqrt(1.0 - q * q) * layer * ln_a_sigma",
        "return math.acos(q), q / math.sqrt(1.0 - q * q) * layer * ln_a_sigma",
        "test_fit_column.py",
    ),
    Fault(
        "chi2 without the fitted parameters",
        "engine",
        "off by one",
        "detect.py",
        "problem.n + span.extra - span.basis.shape[1]",
        "problem.n + span.extra",
        "test_diagnosis.py",
        "freedoms or false_alarms or p_values or noncentrality",
    ),
    Fault(
        "two looks counted as one",
        "engine",
        "factor",
        "detect.py",
        "min(1.0, 2.0 * min(p_chi2, p_score))",
        "min(1.0, min(p_chi2, p_score))",
        "test_diagnosis.py",
        "false_alarms or p_values",
    ),
    Fault(
        "power of the noise without the doubt of its correlation",
        "engine",
        "dropped uncertainty",
        "noise.py",
        "math.sqrt(2.0 / free + 4.0 * (1.0 + rho) / (1.0 - rho) / free)",
        "math.sqrt(2.0 / free)",
        "test_diagnosis.py",
        "noise_is_learned",
    ),
    Fault(
        "heavy tails as sure as normal ones",
        "engine",
        "dropped uncertainty",
        "sources.py",
        "(kurtosis - 1.0) / (4.0 * free)",
        "2.0 / (4.0 * free)",
        "test_learning.py",
        "tails or four_single or null or statement",
    ),
    Fault(
        "information in digits called bits",
        "engine",
        "unit",
        "design.py",
        "float(np.mean(log[k] - np.logaddexp.reduce(mixed, axis=0))) / math.log(2)",
        "float(np.mean(log[k] - np.logaddexp.reduce(mixed, axis=0))) / math.log(10)",
        "test_next_experiment.py",
        "bits or log_odds_of_two or mimic",
    ),
    Fault(
        "gain of few groups by the normal distribution",
        "engine",
        "dropped uncertainty",
        "gain.py",
        "float(scipy.stats.t.ppf(0.5 + 0.5 * level, n - 1))",
        "float(scipy.stats.norm.ppf(0.5 + 0.5 * level))",
        "test_diagnosis.py",
        "interval_of_a_gain",
    ),
    Fault(
        "half the inertial drag",
        "jumper",
        "factor",
        "ground.py",
        '"alpha * v**2"',
        '"0.5 * alpha * v**2"',
        "test_terms.py test_granular.py",
        "law_is or slope or whole_jump or numbers",
    ),
    Fault(
        "overshoot grows with the depth instead of the hole",
        "jumper",
        "names swapped",
        "ground.py",
        "s * z_g * exp(-(z - z_g) / lam)",
        "s * z * exp(-(z - z_g) / lam)",
        "test_terms.py test_granular.py",
        "law_is or slope or whole_jump or numbers",
    ),
    Fault(
        "a moving equilibrium without its damping",
        "jumper",
        "forgotten",
        "arc.py",
        "p0 = (-g - 2.0 * q * d2 - 2.0 * gam * p1) / w2",
        "p0 = (-g - 2.0 * q * d2) / w2",
        "test_hard.py",
        "spline or energy or resonance or thesis",
    ),
    Fault(
        "force of the ground without the foot's inertia",
        "jumper",
        "forgotten",
        "within.py",
        "out[GROUND_FORCE] = force + p.m_f * (p.g + k[0, VF])",
        "out[GROUND_FORCE] = force + p.m_f * p.g",
        "test_granular.py",
        "ground_force or whole_jump or closed_form",
    ),
    Fault(
        "a motor's loop carries the rod instead of the motor",
        "jumper",
        "names swapped",
        "granular.py",
        "p.kp * p.row[6] * (x - s[X]) + p.kd * (v - s[V]) + p.m_m * p.g",
        "p.kp * p.row[6] * (x - s[X]) + p.kd * (v - s[V]) + p.m_r * p.g",
        "test_loop.py",
    ),
    Fault(
        "a foot shakes the rod alone, not rod and foot",
        "jumper",
        "forgotten",
        "oscillator.py",
        "m_f / (M + m_f) * RIPPLE * lift_off_amplitude(k, M, g)",
        "m_f / M * RIPPLE * lift_off_amplitude(k, M, g)",
        "test_oscillator.py",
    ),
    Fault(
        "a kink moves the law the other way",
        "jumper",
        "sign",
        "packing.py",
        "np.stack([-slope, np.ones_like(d), np.minimum(d, 0.0), np.maximum(d, 0.0)], axis=-1)",
        "np.stack([slope, np.ones_like(d), np.minimum(d, 0.0), np.maximum(d, 0.0)], axis=-1)",
        "test_sweep_granular.py",
        "fitted_law or exactly or straight",
    ),
    Fault(
        "a planned motor pushed by the spring as if it were the rod",
        "jumper",
        "names swapped",
        "jumper.py",
        "effort * m.M / (m.m_m * m.rod_mass) + rail / m.m_m - force / m.rod_mass",
        "effort * m.M / (m.m_m * m.rod_mass) + rail / m.m_m - force / m.m_m",
        "test_plan.py",
        "newtons or symbols",
    ),
    Fault(
        "a clock that runs fast counted as slow",
        "jumper",
        "sign",
        "jumper.py",
        "times[here] += offset + rate * tracks.t[here]",
        "times[here] += offset - rate * tracks.t[here]",
        "test_learning.py",
        "common_errors or two_cameras",
    ),
    Fault(
        "a stage's version is no part of its key",
        "experiment",
        "forgotten",
        "workspace.py",
        "json.dumps([made.name, made.version, keys], sort_keys=True, default=str)",
        "json.dumps([made.name, keys], sort_keys=True, default=str)",
        "test_pipeline.py test_unchanged.py",
        "not killed",
    ),
    Fault(
        "a whole exposure in place of half",
        "experiment",
        "factor",
        "track.py",
        "Followed(tracks, frames.time + exposure / 2, exposure",
        "Followed(tracks, frames.time + exposure, exposure",
        "test_exposure.py test_ball_film.py test_films.py",
    ),
    Fault(
        "the default limit of outliers is 20",
        "experiment",
        "factor",
        "parameters.py",
        'outlier: float = param(2.0, "", "normalised median test',
        'outlier: float = param(20.0, "", "normalised median test',
        "test_piv.py",
        "reflection or median",
    ),
    Fault(
        "the start of a log is forgotten",
        "experiment",
        "forgotten",
        "logs.py",
        "{columns[0]: time + start}",
        "{columns[0]: time}",
        "test_logs.py",
    ),
    Fault(
        "fields of another program half a gap early",
        "experiment",
        "off by one",
        "vectors.py",
        "section.stride * np.arange(n) + 0.5 * section.gap",
        "section.stride * np.arange(n)",
        "test_vectors.py",
    ),
    Fault(
        "packings of one camera taken as independent",
        "experiment",
        "forgotten",
        "craters.py",
        "independent(total, alike), independent(dphi, alike_phi)",
        "independent(total, alike), independent(dphi, 0.0 * alike_phi)",
        "test_budget.py",
        "critical_packing",
    ),
    Fault(
        "a field's time is that of its first picture",
        "experiment",
        "factor",
        "piv.py",
        "of_fields(0.5 * (begin + end), p)",
        "of_fields(begin, p)",
        "test_films.py test_flow_film.py",
    ),
    Fault(
        "momentum goes with the scale's third power",
        "experiment",
        "factor",
        "flow.py",
        "math.hypot(4.0 * scale, rate, phi)",
        "math.hypot(3.0 * scale, rate, phi)",
        "test_budget.py",
        "grains_and_their_fits",
    ),
    Fault(
        "a field is written column by column",
        "report",
        "axis",
        "images.py",
        'data[names].isel(t=k).transpose("y", "x")',
        'data[names].isel(t=k).transpose("x", "y")',
        "test_export.py",
        "vtk_reads",
    ),
    Fault(
        "a band of two sigmas is one wide",
        "report",
        "factor",
        "grains.py",
        "axis.fill_between(x, y - 2 * sigma, y + 2 * sigma, color=color, alpha=0.25, lw=0)",
        "axis.fill_between(x, y - sigma, y + sigma, color=color, alpha=0.25, lw=0)",
        "test_figures.py",
        "grains_hold or band",
    ),
    Fault(
        "volumes a thousand times too small on a page",
        "report",
        "unit",
        "quantities.py",
        '"m3": ("cm³", 1e6)',
        '"m3": ("cm³", 1e3)',
        "test_report.py",
        "fits_stand or strength or typeset or units",
    ),
    Fault(
        "a model's parameter moved by both its sigmas",
        "sweeps",
        "factor",
        "comparison.py",
        "(height(*high) - height(*low)) * share for name, low, high, share",
        "(height(*high) - height(*low)) for name, low, high, share",
        "test_hard_compare.py",
    ),
    Fault(
        "a line under the film keeps its lowest points alone",
        "browser",
        "names swapped",
        "logs.py",
        "for k in (y[a:b].argmin(), y[a:b].argmax())",
        "for k in (y[a:b].argmin(), y[a:b].argmin())",
        "test_workbench.py",
        "extremes",
    ),
    Fault(
        "free disk in MB told as GB",
        "cli",
        "unit",
        "machine.py",
        "shutil.disk_usage(place).free / 1e9",
        "shutil.disk_usage(place).free / 1e6",
        "test_doctor.py",
    ),
    Fault(
        "rate of the rod's film given to the grains'",
        "cli",
        "names swapped",
        "init.py",
        '"rate": eye.grain_rate',
        '"rate": eye.rod_rate',
        "test_init.py",
    ),
    Fault(
        "probability of a box without the scale of its later sides",
        "base",
        "forgotten",
        "arrays.py",
        "off = drawn[:, :k] @ root[k, :k] / root[k, k]",
        "off = drawn[:, :k] @ root[k, :k]",
        "test_diagnosis.py",
        "evidence",
    ),
    Fault(
        "height of a flight by half its slope",
        "estimate",
        "factor",
        "flight.py",
        "gravity * time / 4.0 * sigma",
        "gravity * time / 8.0 * sigma",
        "test_fit_flight.py",
        "contact",
    ),
    Fault(
        "most likely displacement on the other side of the line",
        "estimate",
        "sign",
        "robot.py",
        "true = at + miss * k * x_sigma**2 / variance",
        "true = at - miss * k * x_sigma**2 / variance",
        "test_stiffness.py",
    ),
    Fault(
        "work by the force at the end of each step",
        "estimate",
        "off by one",
        "robot.py",
        "work = float(np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(x)))",
        "work = float(np.sum(f[1:] * np.diff(x)))",
        "test_actuator.py",
        "power",
    ),
    Fault(
        "mean of trials without what they differ by",
        "estimate",
        "dropped uncertainty",
        "mean.py",
        "u = np.sqrt(np.bincount(at, w**2 * (s**2 + scatter[at] ** 2)))",
        "u = np.sqrt(np.bincount(at, w**2 * s**2))",
        "test_hard_compare.py",
        "uniform or repeats or beforehand",
    ),
    Fault(
        "nanoseconds of a shutter taken for microseconds",
        "films/frames",
        "unit",
        "mraw.py",
        'number(path, header, "shutter_ns") * 1e-9',
        'number(path, header, "shutter_ns") * 1e-6',
        "test_frames_raw.py",
    ),
    Fault(
        "jackknife of a foot's face as if blocks were all of it",
        "films/vision",
        "factor",
        "foot_face.py",
        "math.sqrt((blocks - 1) / blocks * float(np.sum((others - centre) ** 2)))",
        "math.sqrt(1.0 / blocks * float(np.sum((others - centre) ** 2)))",
        "test_foot.py",
    ),
    Fault(
        "two rays apart without the doubt of the cameras",
        "films/arrays",
        "dropped uncertainty",
        "space.py",
        "np.hypot(own[3], common[3])",
        "np.hypot(own[3], 0.0 * common[3])",
        "test_stereo.py",
    ),
    Fault(
        "errors of vectors alike over the square of their length",
        "films/vision",
        "factor",
        "validate.py",
        "return float(1 / np.sqrt((seen**2).mean()))",
        "return float(1 / (seen**2).mean())",
        "test_piv.py",
        "stated_length",
    ),
    Fault(
        "a sharp front between two vectors as sure as they are",
        "films/grains",
        "dropped uncertainty",
        "front.py",
        "place = step * math.hypot(noise, 12.0**-0.5)",
        "place = step * noise",
        "test_fit_column.py",
    ),
    Fault(
        "a narrowing cone's mass to second order",
        "films/grains",
        "factor",
        "cone.py",
        "slope * d * (1.0 - q + q * q / 3.0)",
        "slope * d * (1.0 - q + q * q / 2.0)",
        "test_cone_fit.py",
    ),
    Fault(
        "added mass as if the foot's speed were known",
        "films/grains",
        "dropped uncertainty",
        "momentum.py",
        "return mass, np.hypot(ps, mass * vs) / np.abs(v)",
        "return mass, ps / np.abs(v)",
        "test_field.py",
    ),
    Fault(
        "volume of a prediction counted for it",
        "engine",
        "sign",
        "naming.py",
        "0.5 * float(np.linalg.slogdet(hessian)[1] - np.linalg.slogdet(rest)[1])",
        "0.5 * float(np.linalg.slogdet(rest)[1] - np.linalg.slogdet(hessian)[1])",
        "test_diagnosis.py",
        "held_out_score",
    ),
    Fault(
        "one look and two signs in what a protocol shows",
        "engine",
        "factor",
        "isolable.py",
        "LEVEL / (4.0 * max(len(causes), 1))",
        "LEVEL / (2.0 * max(len(causes), 1))",
        "test_isolable.py",
        "least_squares",
    ),
    Fault(
        "a range as wide as its own standard deviation",
        "engine",
        "factor",
        "priors.py",
        "(p.high - p.low) ** 2 / 12.0",
        "(p.high - p.low) ** 2 / 3.0",
        "test_learning.py",
        "priors or chance or range_alone",
    ),
    Fault(
        "share of the rod in place of the motor's",
        "jumper",
        "names swapped",
        "energy.py",
        "share = motor_mass / mass",
        "share = rod_mass / mass",
        "test_sweep.py",
        "powers",
    ),
    Fault(
        "speed at a pressure by half of the root",
        "jumper",
        "factor",
        "air.py",
        "2.0 * gradient / (a + math.sqrt(a * a + 4.0 * b * gradient))",
        "2.0 * gradient / (a + math.sqrt(a * a + 2.0 * b * gradient))",
        "test_fluidisation.py",
    ),
    Fault(
        "forces grow with a foot's radius, not its area",
        "jumper",
        "factor",
        "jumper.py",
        "area = (own.foot_radius / model.foot_radius) ** 2",
        "area = own.foot_radius / model.foot_radius",
        "test_many_beds.py",
        "grows_with_the_foot",
    ),
    Fault(
        "a laser's angle by its tangent",
        "experiment",
        "names swapped",
        "crater.py",
        "rise = 1.0 / math.sin(section.laser_angle)",
        "rise = 1.0 / math.tan(section.laser_angle)",
        "test_crater.py test_budget.py",
        "crater",
    ),
    Fault(
        "a leaning rail foreshortens by the mean, not its square",
        "experiment",
        "factor",
        "recordings.py",
        "return 0.5 * math.sqrt(3.0) * tilt_sigma**2",
        "return 0.5 * tilt_sigma**2",
        "test_budget.py",
        "rail",
    ),
    Fault(
        "the last excluded frame is taken",
        "experiment",
        "off by one",
        "recordings.py",
        "range(int(first), min(int(last or first) + 1, frames))",
        "range(int(first), min(int(last or first), frames))",
        "test_ball_film.py test_experiment.py test_schema.py",
        "exclu or values or film",
    ),
    Fault(
        "a motor's greatest force by cycles, not radians",
        "experiment",
        "unit",
        "geometry.py",
        "robot.motor_mass * law.amplitude * (2.0 * math.pi * law.frequency) ** 2",
        "robot.motor_mass * law.amplitude * law.frequency**2",
        "test_fluidisation.py",
    ),
    Fault(
        "an integrated disc drawn on the other side of its axis",
        "report",
        "sign",
        "bed.py",
        '(-y + v["radius_m"] * np.sin(turn)) / scale',
        '(y + v["radius_m"] * np.sin(turn)) / scale',
        "test_crater.py test_figures.py",
        "format or grains or depth or drawn_disc",
    ),
    Fault(
        "a model called lower where it is higher",
        "report",
        "sign",
        "words.py",
        "off = float(np.nanmean(model - h))",
        "off = float(np.nanmean(h - model))",
        "test_report.py",
        "first_screen or units or truth or which_side",
    ),
    Fault(
        "errors of heights told in the wrong order",
        "cli",
        "names swapped",
        "terminal.py",
        "{said(g.rmse_height_before_m, '.2f', 1e3)} -> {said(g.rmse_height_after_m, '.2f', 1e3)} mm rms",
        "{said(g.rmse_height_after_m, '.2f', 1e3)} -> {said(g.rmse_height_before_m, '.2f', 1e3)} mm rms",
        "test_question.py",
    ),
)


class Place(NamedTuple):
    """A file below the root, and its text with the fault in it."""

    file: Path
    text: str


class Outcome(NamedTuple):
    """What became of a fault: caught by a test, SURVIVED, or why it was not measured; s it took."""

    fault: Fault
    by: str
    seconds: float

    @property
    def caught(self) -> bool | None:
        """None where it was not measured."""
        return None if self.by.startswith("not ") else self.by != SURVIVED


SURVIVED = "SURVIVED"


def place_of(fault: Fault) -> Place:
    """The one place of a fault in the package, in a file of its name or else in any. LookupError: what to look for."""
    tokens = re.findall(r"\w+|[^\w\s]", fault.old)
    pattern = re.compile(r"\s*".join(map(re.escape, tokens)))
    files = [f for f in sorted((ROOT / "jumpvision").rglob("*.py")) if "laboratory" not in f.parts]
    for some in ([f for f in files if f.name == fault.file], files):
        texts = {f: f.read_text(encoding="utf-8") for f in some}
        found = [(f, m) for f, text in texts.items() for m in pattern.finditer(text)]
        if len(found) > 1:
            raise LookupError(f"not unique: {fault.old} is there {len(found)} times: write more of it")
        for f, m in found:
            text = texts[f][: m.start()] + fault.new + texts[f][m.end() :]
            ast.parse(text)
            return Place(f.relative_to(ROOT), text)
    raise LookupError(f"not found: look for {fault.old} (it was in a {fault.file}) and write it as it is now")


def copied(target: Path) -> None:
    """The tree as it is now, times of files and all, so that compiled code of an earlier copy is known again."""
    for f in target.rglob("*.py"):
        if not (ROOT / f.relative_to(target)).exists():
            f.unlink()
    target.mkdir(parents=True, exist_ok=True)
    for f in (f for pattern in COPIED for f in ROOT.glob(pattern)):
        copy = functools.partial(shutil.copytree, dirs_exist_ok=True) if f.is_dir() else shutil.copy2
        copy(f, target / f.name)


def tested(copy: Path, fault: Fault, limit: float, compiled: str = "") -> tuple[int | None, str]:
    """(pytest's exit code, None beyond the limit; what it said) of a fault's tests in a copy. compiled: where numba
    keeps code, its own place where none is given."""
    call = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-q", "-p", "no:cacheprovider", "--tb=line"]
    files = [str(f.relative_to(copy)) for name in fault.tests.split() for f in (copy / "tests").rglob(name)]
    call += files + (["-k", fault.select] if fault.select else [])
    own = {"PYTHONPATH": str(copy)} | ({"NUMBA_CACHE_DIR": compiled} if compiled else {})
    with tempfile.TemporaryFile("w+", encoding="utf-8") as said:
        run = subprocess.Popen(
            call, cwd=copy, env={**os.environ, **own}, stdout=said, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            code = run.wait(limit)
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
            code = None
        said.seek(0)
        return code, said.read()


class Bench:
    """A copy of the tree in which one fault at a time is put; what its tests take without one is asked once."""

    def __init__(self, copy: Path):
        copied(copy)
        self.copy, self.calm = copy, dict[tuple[str, str], float | str]()

    def without(self, fault: Fault) -> float | str:
        """Time [s] that the tests of a fault take without it, or why they do not pass."""
        key = fault.tests, fault.select
        if key not in self.calm:
            began = time.perf_counter()
            code, said = tested(self.copy, fault, 10.0 * LEAST)
            why = (FIRST.findall(said) or said.strip().splitlines() or ["no answer"])[-1]
            self.calm[key] = time.perf_counter() - began if code == 0 else f"not measured: without the fault {why}"
        return self.calm[key]

    def judged(self, fault: Fault) -> Outcome:
        """Whether the fault's tests notice it."""
        began = time.perf_counter()
        try:
            place = place_of(fault)
        except LookupError as e:
            return Outcome(fault, str(e), 0.0)
        calm = self.without(fault)
        if isinstance(calm, str):
            return Outcome(fault, calm, time.perf_counter() - began)
        target, began = self.copy / place.file, time.perf_counter()
        kept = target.with_name(target.name + ".kept")
        target.rename(kept)  # renamed back it has its old time, and what was compiled of it is known again
        try:
            target.write_text(place.text, encoding="utf-8")
            with tempfile.TemporaryDirectory() as fresh:  # numba sees no change of what a function calls elsewhere
                compiled = fresh if COMPILED.search(place.text) else ""
                code, said = tested(self.copy, fault, LEAST + SLOWER * calm, compiled)
        finally:
            kept.replace(target)
        took = time.perf_counter() - began
        by = "no end" if code is None else SURVIVED if code == 0 else (FIRST.findall(said) or ["no test: an error"])[0]
        return Outcome(fault, by, took)


def outcomes(faults: list[Fault], jobs: int, folder: Path) -> Iterator[Outcome]:
    """Of every fault in their order, so many at a time, each job with a copy in the folder."""
    free: queue.SimpleQueue[Bench] = queue.SimpleQueue()
    for k in range(jobs):
        free.put(Bench(folder / f"tree-{k}"))

    def one(fault: Fault) -> Outcome:
        bench = free.get()
        try:
            return bench.judged(fault)
        finally:
            free.put(bench)

    with ThreadPoolExecutor(jobs) as pool:
        for found in pool.map(one, faults):
            print(f"{found.fault.name}: {found.by} ({found.seconds:.0f} s)", file=sys.stderr, flush=True)
            yield found


def share(caught: int, n: int) -> str:
    """`58 of 60, 97 ± 3 %`: the error of a share whose every value was alike before (Laplace), so of all too."""
    p = (caught + 1) / (n + 2)
    return f"{caught} of {n}, {100 * caught / max(n, 1):.0f} ± {100 * math.sqrt(p * (1 - p) / (n + 3)):.0f} %"


def told(found: list[Outcome]) -> None:
    """Print markdown."""
    print("| fault | wing | kind | noticed by | s |\n|---|---|---|---|---|")
    for o in found:
        print(f"| {o.fault.name} | {o.fault.wing} | {o.fault.kind} | {o.by} | {o.seconds:.0f} |")
    judged = [o for o in found if o.caught is not None]
    print("\n| wing | noticed |\n|---|---|")
    for wing in dict.fromkeys(o.fault.wing for o in judged):
        mine = [o.caught for o in judged if o.fault.wing == wing]
        print(f"| {wing} | {sum(map(bool, mine))} of {len(mine)} |")
    print(f"\nNoticed: {share(sum(bool(o.caught) for o in judged), len(judged))}.")
    if left := len(found) - len(judged):
        print(f"Not measured: {left}, see the table.")


def main() -> int:
    """0 where every fault was measured; a survivor is a result, no failure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="faults with one of these in the name")
    parser.add_argument("--wing", default="", help="faults of this wing, as estimate or films")
    parser.add_argument("--list", action="store_true", help="what there is, and whether each is found in the code")
    parser.add_argument("--jobs", type=int, default=1, help="faults at a time")
    parser.add_argument("--copy", type=Path, help="folder of the copied tree, used again; default: a temporary one")
    a = parser.parse_args()
    chosen = [f for f in FAULTS if f.wing.startswith(a.wing) and (not a.only or any(o in f.name for o in a.only))]
    if a.list:
        return listed(chosen)
    with tempfile.TemporaryDirectory() as folder:
        found = list(outcomes(chosen, max(a.jobs, 1), a.copy or Path(folder)))
    told(found)
    return int(any(o.caught is None for o in found))


def listed(faults: list[Fault]) -> int:
    """Print the faults with their places; 1 where one has none any more."""
    lost = 0
    for f in faults:
        try:
            where = str(place_of(f).file)
        except LookupError as e:
            where, lost = str(e), 1
        print(f"{f.wing:13s} {f.kind:20s} {f.name}\n    {where}; {f.tests} {f.select}".rstrip())
    return lost


if __name__ == "__main__":
    sys.exit(main())
