"""What the stages of the command line give, to lay beside what a page shows; a study of one's own for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from jumpvision.cli import main

STUDY = """
import numpy as np
import jumpvision as jv

def thrown(p, r):
    return p["up"] * r.t - 0.5 * p["g"] * r.t**2 + 0 * r.inputs["rod_video"]["scale"]

def dies(p, r):
    raise OSError("no licence")

def begins(r):
    return (r.values[1] - r.values[0]) / (r.t[1] - r.t[0])

study = jv.Study(thrown, [jv.Parameter("g", 9.0, (5, 15), unit="m/s^2"),
                          jv.Parameter("up", begins, (-9, 9), each=True, sigma=0.1, unit="m/s")],
                 channels=[jv.Channel("height", "m")])
two = jv.Study(lambda p, r: np.zeros((r.t.size, 2)), [jv.Parameter("g", 9.0, (5, 15))],
               channels=[jv.Channel("a", "m"), jv.Channel("b", "m")])
broken = jv.Study(dies, [jv.Parameter("g", 9.0, (5, 15))], channels=[jv.Channel("height", "m")])
"""


def stage(name: str, folder: Path) -> Path:
    """Run a stage on an experiment and return the folder of its results, which the workbench does not look into."""
    results = folder.parent / f"{folder.name}-results"
    assert main([name, str(folder), "--results", str(results), "--no-pictures"]) == 0
    return results


def of_file(file: Path, k: int) -> xr.Dataset:
    """Read field k of a file."""
    with xr.open_dataset(file, decode_times=False) as data:
        return data.isel(t=k).load().transpose("y", "x")


def same(shown: list, values: np.ndarray) -> None:
    """Assert that two fields are equal to the last bit."""
    assert np.array_equal(np.array(shown, float), values.ravel(), equal_nan=True)
