"""Small experiments and campaigns that are written and analysed in a second, and what is asked of their results."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.schema import InputError

SAMPLES = Path(__file__).parents[2] / "data_samples"
TERMS = 'citation = "Doe et al., J. Exp. 7 (2024), doi:10.1234/abc.5"\nlicense = "CC-BY-4.0"\n'
CAMPAIGN = f'{TERMS}ground = "hard"\n[robot]\nmotor_mass = 1.003\nrod_mass = 0.175\nspring_stiffness = 5760.6\n'
EXPERIMENT = """[actuation]
kind = "stutter"
frequency = {frequency}
amplitude = 0.004
phase = 1.57
start = 0.1
[rod_track]
file = "rod_track.csv"
"""


FILMED = """
ground = "hard"
[robot]
motor_mass = 1.0
rod_mass = 0.2
spring_stiffness = 5000.0
[actuation]
kind = "stutter"
frequency = 8.0
amplitude = 0.004
start = 0.05
[rod_video]
file = "rod.avi"
scale = 5e-4
ball_diameter = 0.0095
[motor_log]
file = "motor.csv"
[contact_log]
file = "contact.csv"
[model]
terms = []
"""


def ball_film(n: int = 24) -> np.ndarray:
    """A bright disc that rises and falls; drawn coarsely, which is enough here."""
    y, x = np.mgrid[:90, :48]
    rng = np.random.default_rng(1)
    frames = []
    for i in range(n):
        r = np.hypot(x - 24.3, y - (60 - 0.08 * i * (n - i)))
        frames.append(20 + 180 * np.clip(9.5 - r + 0.5, 0, 1) + rng.normal(0, 2, x.shape))
    return np.clip(np.stack(frames), 0, 255).astype(np.uint8)


def filmed_experiment(folder: Path) -> Path:
    """An experiment of a film, a motor's log and a contact log that runs without an error."""
    from jumpvision.laboratory import write

    folder.mkdir(parents=True)
    (folder / "experiment.toml").write_text(FILMED)
    write.film(folder / "rod.avi", ball_film(), rate=200.0)
    t = np.arange(0, 0.4, 1e-3)
    phase = 2 * np.pi * 8 * np.clip(t - 0.05, 0, 0.125)
    rows = [f"{a:.4f},{0.004 * (np.cos(b) - 1):.7f}" for a, b in zip(t, phase)]
    (folder / "motor.csv").write_text("time_s,position_m\n" + "\n".join(rows) + "\n")
    (folder / "contact.csv").write_text("time_s,contact\n" + "\n".join(f"{a:.4f},{int(a < 0.12)}" for a in t) + "\n")
    return folder


def edit(folder: Path, old: str, new: str) -> None:
    """Replace text of experiment.toml."""
    file = folder / "experiment.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def make(folder: Path, text: str = "", **files: str) -> Path:
    """An experiment of this text; rod_csv is the file rod.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "experiment.toml").write_text(text)
    for name, content in files.items():
        (folder / name.replace("_csv", ".csv")).write_text(content)
    return folder


def problems_of(call: Callable[..., object], *args: Any, **kwargs: Any) -> list[str]:
    """What a call refuses."""
    try:
        call(*args, **kwargs)
    except InputError as e:
        return e.problems
    raise AssertionError("not refused")


def grain_film(folder: Path, frames: int) -> Path:
    """An experiment with a film of grains that move by 0.7 px a frame, over a frame of 48 x 48 px."""
    from scipy import ndimage

    rng = np.random.default_rng(4)
    wide = ndimage.gaussian_filter(rng.standard_normal((48, 60)), 1.5)
    wide = 120 + 60 * wide / wide.std()
    few = [ndimage.shift(wide, (0.0, -0.7 * i), order=3)[:, :48] for i in range(12)]
    folder.mkdir(parents=True)
    np.save(folder / "grains.npy", np.clip(few, 0, 255).astype(np.uint8)[np.arange(frames) % 12])
    (folder / "experiment.toml").write_text(
        '[grain_video]\nfile = "grains.npy"\nframe_rate = 500.0\nscale = 1e-4\n[params.piv]\nwindow = 16\nstep = 8\n'
    )
    return folder


def write_campaign(root: Path, n: int, *, seed: int = 1, rate: float = 100.0) -> Path:
    """n experiments, each a flight with noise of 20 um in a table; no films, no [model]. At 200 Hz their fits take five
    times as long: for who measures that, or kills it at work."""
    root.mkdir(parents=True)
    (root / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    rng = np.random.default_rng(seed)
    for i in range(n):
        folder = root / f"jump-{i:04d}"
        folder.mkdir()
        frequency, speed = rng.uniform(6, 12), rng.uniform(0.4, 0.6)
        (folder / "experiment.toml").write_text(EXPERIMENT.format(frequency=frequency), encoding="utf-8")
        t = np.arange(0, 0.75, 1.0 / rate)  # little after the landing: a ring-down to be fitted takes long
        flight = t - 0.1 - 1 / frequency
        height = np.where(flight > 0, np.maximum(speed * flight - 1.35 * flight**2, 0), 0) + rng.normal(0, 2e-5, t.size)
        rows = np.column_stack([t, height])
        np.savetxt(folder / "rod_track.csv", rows, "%.6f", ",", header="time_s,height_m", comments="")
    return root


def results_of(folder: Path) -> dict[str, bytes]:
    """Every result file by its path; of provenance.json and campaign.json what does not change from run to run."""
    found = {}
    for f in sorted(folder.rglob("*")):
        name = f.relative_to(folder).as_posix()
        if f.is_file() and not name.startswith(".cache/") and f.name != "report.html":
            found[name] = f.read_bytes()
            if f.name == "campaign.json":
                found[name] = json.dumps(json.loads(found[name])["tables"]).encode()
            if f.name == "provenance.json":
                data = json.loads(found[name])
                found[name] = json.dumps({k: data[k] for k in ("inputs", "outputs", "parameters")}).encode()
    return found


def leftovers(folder: Path) -> list[Path]:
    """Temporary files and unfinished cache entries."""
    return [f for f in folder.rglob("*") if f.name.startswith("writing-") or f.name.endswith(".tmp")]


def run_here(campaign: Path, results: Path, *options: str) -> int:
    """`jumpvision run` in this process, with one worker and without pictures; its exit code."""
    from jumpvision.cli import main

    return main(["run", str(campaign), "--results", str(results), "--workers", "1", "--no-pictures", *options])
