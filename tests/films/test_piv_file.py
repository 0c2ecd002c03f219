"""The field file of stage piv, written pair by pair."""

import gc
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from jumpvision.base.record import RecordError
from jumpvision.experiment.results import fields
from jumpvision.experiment.results.fields import TOGETHER, Piv, Planes
from jumpvision.experiment.stages.grains.statistics import mean_of
from jumpvision.films.grains.steady import Memory, independent

N = 2 * TOGETHER + 3


def head(n):
    return xr.Dataset(
        {"foot_y": ("t", np.arange(n) * 0.5)},
        coords={"x": ("x", [0.0, 1.0, 2.0]), "y": ("y", [1.0, 0.0]), "t": ("t", np.arange(n) * 0.1)},
        attrs={"files": ["a.avi"]},
    )


def planes(n):
    for k in range(n):
        u = np.full((2, 3), float(k))
        u[0, 0] = np.nan
        yield xr.Dataset(
            {
                "u": (("y", "x"), u, {"units": "m/s"}),
                "reason": (("y", "x"), np.full((2, 3), k % 8, np.int8), {"flag_values": np.arange(8, dtype=np.int8)}),
            }
        )


def test_the_file_holds_every_pair_and_goes_with_the_record(tmp_path):
    record = Piv.write(head(N), planes(N))
    record.save(tmp_path)
    for field in (record.field, Piv.load(tmp_path).field):
        assert field.u.dims == ("y", "x", "t") and field.sizes["t"] == N
        assert np.array_equal(field.u.values[1, 1], np.arange(N)) and np.isnan(field.u.values[0, 0]).all()
        assert field.reason.dtype == np.int8 and list(field.reason.values[1, 2]) == [k % 8 for k in range(N)]
        assert field.u.attrs["units"] == "m/s" and field.attrs["files"] == "a.avi"
        assert field.foot_y.values[-1] == 0.5 * (N - 1)
    folder = record.written.parent
    assert folder.is_dir()
    del record, field
    gc.collect()
    assert not folder.exists()


@pytest.fixture(autouse=True)
def as_of_many_vectors(monkeypatch):
    """The fields of these tests are small: their times would lie in one piece."""
    monkeypatch.setattr(fields, "SMALLEST", 1)


def test_each_time_is_the_one_asked_for(tmp_path, monkeypatch):
    """Times of few vectors lie together in pieces of some size: a film of 100,000 small pictures lay in 6,250 of each
    variable, which HDF5 all keeps in mind."""
    for smallest, together in ((1, TOGETHER), (20 * 2 * 3, 20)):
        monkeypatch.setattr(fields, "SMALLEST", smallest)
        (tmp_path / str(together)).mkdir()
        Piv.write(head(N), planes(N)).save(tmp_path / str(together))
        field = Piv.load(tmp_path / str(together)).field
        assert field.u.encoding["chunksizes"] == (2, 3, together)
        each = Planes(field, ("u",))
        assert len(each) == N and set(each[0].data_vars) == {"u"}
        assert [float(f.u[1, 1]) for f in each] == list(range(N))
        for i in (N - 1, 0, TOGETHER, -2, TOGETHER - 1):
            assert each[i].u.identical(field.u.isel(t=i))
        with pytest.raises(IndexError):
            each[N]


def test_a_film_that_ends_early_is_an_error_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for n in (0, N - 1):
        with pytest.raises(RecordError, match=f"{n} of {N} times"):
            Piv.write(head(N), planes(n))
    assert not list(tmp_path.iterdir())


def test_a_mean_over_a_long_field_is_that_of_all_its_times_at_once():
    """Read part by part; against numpy's own mean and standard deviation and Student's t, with times and places that
    are not known."""
    rng = np.random.default_rng(4)
    values = 50.0 + rng.normal(size=(3, 4, 40))
    values[rng.uniform(size=values.shape) < 0.2] = np.nan
    values[0, 0, 6:] = np.nan  # known once: no mean
    values[0, 1, 7:] = np.nan
    field = xr.DataArray(values, dims=("y", "x", "t"), coords={"t": np.arange(40.0)})
    mean, sigma = mean_of(field, field.t[5:])
    known = np.where(np.isfinite(values[..., 5:]).sum(-1, keepdims=True) >= 2, values[..., 5:], np.nan)
    worth = independent(np.isfinite(known).sum(-1), 35, Memory.of(known.reshape(12, 35).T[:, 1:]).mean)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        np.testing.assert_allclose(mean, np.nanmean(known, axis=-1), rtol=1e-13)
        half = stats.t.ppf(stats.norm.cdf(1.0), np.maximum(worth, 1.5) - 1.0) / np.sqrt(worth)
        np.testing.assert_allclose(sigma, half * np.nanstd(known, axis=-1, ddof=1), rtol=1e-10)
    assert np.isnan(mean[0, 0]) and np.isfinite(mean).sum() == 11


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc, which tells the memory of a process")
def test_what_was_read_of_a_long_field_does_not_stay_in_memory(tmp_path):
    """NetCDF keeps up to 64 MB of each variable that is read: 3 x 49 MB here, of a real film's 13 variables all."""
    grown = subprocess.check_output(
        [sys.executable, "-c", READ], text=True, env={**os.environ, "TMPDIR": str(tmp_path)}
    )
    assert float(grown) < 30.0  # of 147 MB that were read


READ = """
import numpy as np, xarray as xr
from jumpvision.experiment.results.fields import Piv, Planes

def memory():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

n, s = 1500, 64
head = xr.Dataset(coords={"x": np.arange(s) * 1.0, "y": -np.arange(s) * 1.0, "t": np.arange(n) * 1.0})
each = ({v: xr.Variable(("y", "x"), np.full((s, s), k), {"units": "1"}) for v in "abc"} for k in np.arange(n) * 1.0)
field = Piv.write(head, each).field
before = memory()
assert [float(f.b[3, 4]) for f in Planes(field)] == list(range(n))
print(memory() - before)
"""
