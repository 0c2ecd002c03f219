"""`jv.flow`, `statistics`, `export`, `plot` of velocity fields, and double exposures, against known truth.

Truth: exact velocities (a solid rotation, a shear) with Gaussian errors of a known size, and particles drawn as
Gaussian spots at exact places. Nothing here comes from the code under test.
"""

from __future__ import annotations

import json
import warnings

import matplotlib
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import jumpvision as jv
from jumpvision.base.schema import InputError

matplotlib.use("Agg")
H, W = 120, 152


def spots(places: np.ndarray) -> np.ndarray:
    """Particles of 1.1 px (standard deviation) at places (n, 2) [px, x y], with the camera's rounding."""
    y, x = np.mgrid[:H, :W]
    image = np.full((H, W), 10.0)
    for px, py in places:
        part = np.s_[max(0, int(py) - 6) : int(py) + 7, max(0, int(px) - 6) : int(px) + 7]
        image[part] += 180.0 * np.exp(-((x[part] - px) ** 2 + (y[part] - py) ** 2) / (2 * 1.1**2))
    return np.rint(image.clip(0, 255)).astype(np.uint8)


def seeded(rng: np.random.Generator, n: int = 1100) -> np.ndarray:
    return rng.uniform([-20, -20], [W + 20, H + 20], (n, 2))


def drawn(u, v, *, sigma: float, times: int = 1, seed: int = 0, unit: str = "m") -> xr.Dataset:
    """A field of another maker: u(x, y), v(x, y) with independent errors of `sigma`; y up; no attributes of ours."""
    rng = np.random.default_rng(seed)
    x, y = 0.002 * np.arange(30), 0.002 * np.arange(24)[::-1]
    X, Y = np.meshgrid(x, y)
    shape = (24, 30, times)
    data = {n: f(X, Y)[..., None] + rng.normal(0.0, sigma, shape) for n, f in (("u", u), ("v", v))}
    both = {n: (("y", "x", "t"), a, {"units": f"{unit}/s"}) for n, a in data.items()}
    sigmas = {f"{n}_sigma": (("y", "x", "t"), np.full(shape, sigma), {"units": f"{unit}/s"}) for n in "uv"}
    places = {"x": ("x", x, {"units": unit}), "y": ("y", y, {"units": unit, "long_name": "up"})}
    return xr.Dataset(both | sigmas, coords=places | {"t": ("t", 0.01 * np.arange(times), {"units": "s"})})


TURN = 3.0  # 1/s


@pytest.fixture(scope="module")
def rotation():
    """Two pictures of particles turned by 0.03 rad about the middle, counter-clockwise as y up sees it, and the true
    vorticity: a particle moves by 2 tan(angle / 2) times its distance at half-way."""
    rng, angle = np.random.default_rng(4), 0.03
    at = seeded(rng) - [W / 2, H / 2]
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])  # rows count down
    a, b = (spots(at @ m.T + [W / 2, H / 2]) for m in (np.eye(2), turn))
    return a, b, 4.0 * np.tan(angle / 2)


def test_the_vorticity_of_a_picture_that_turns(rotation):
    a, b, true = rotation
    field = jv.piv(a, b, window=24, step=8)
    assert abs(field.attrs["error_correlation_length_px"] - 17.7) < 1.0  # px: measured, docs/stages/piv.md
    found = jv.flow(field)
    assert found.vorticity.dims == ("y", "x") and found.equals(field.jv.flow())
    pull = ((found.vorticity - true) / found.vorticity_sigma).values
    known = pull[np.isfinite(pull)]
    assert known.size > 100
    independent = known.size / (24 / 8 + 2) ** 2  # windows overlap, and planes share their vectors
    assert abs(known.mean()) < 3.5 * max(1.0, known.std()) / np.sqrt(independent)
    assert abs(float(found.vorticity.median()) / true - 1.0) < 0.02
    scaled = jv.flow(jv.piv(a, b, window=24, step=8, scale=1e-4, frame_rate=50.0))
    np.testing.assert_allclose(scaled.vorticity, 50.0 * found.vorticity, rtol=1e-9)  # 1/s: the scale goes out
    with pytest.raises(InputError, match=r"scale = 0.5: must be a number in \(0, 0.01\]"):
        jv.piv(a, b, scale=0.5)


def test_statistics_of_a_known_turbulence():
    """Fluctuations of 0.02 m/s, the noise of 0.005 m/s taken out; sigmas: test_steady.py."""
    n, fluctuation, noise, rng = 200, 0.02, 0.005, np.random.default_rng(3)
    field = drawn(lambda x, y: 0.3 + 0 * x, lambda x, y: -TURN * x, sigma=noise, times=n, seed=2)
    for name in "uv":
        field[name] = field[name] + rng.normal(0.0, fluctuation, field[name].shape)
    mean = jv.statistics(field, window=1.0)
    assert abs(float(mean.u.mean()) - 0.3) < 4.0 * fluctuation / np.sqrt(n * mean.u.size)
    assert abs(float(mean.tke.mean()) / fluctuation**2 - 1.0) < 3.5 / np.sqrt(n * mean.u.size / 2) + 0.01
    one_by_one = jv.statistics([field.isel(t=k) for k in range(n)], window=1.0)
    for name in ("u", "v", "uu", "vv", "uv", "n", "vorticity"):
        np.testing.assert_allclose(one_by_one[name], mean[name], rtol=1e-9, atol=1e-12)
    for given, said in (
        (field.isel(t=slice(0, 1)), "1 field; the scatter of a mean needs 2"),
        ([field.isel(t=0), field.isel(t=1, x=slice(1, None))], "field 1 has its vectors elsewhere"),
    ):
        with pytest.raises(InputError, match=said):
            jv.statistics(given)


@pytest.fixture(scope="module")
def doubles():
    """A1, B1, A2, B2, A3, B3: from A to B all move by (1.7, -0.6) px, from B to the next A by (0.3, 0.5) px."""
    at, moved, between = seeded(np.random.default_rng(5), 600), np.array([1.7, -0.6]), np.array([0.3, 0.5])
    places = [at + k * (moved + between) + b * moved for k in range(3) for b in (0, 1)]
    return np.array([spots(p) for p in places]), moved


def test_the_clock_of_double_exposures_and_of_their_ensemble(doubles):
    """Within what the sigmas say of a median; with B1 to A2 among the pairs that are matched together it is far off."""
    frames, moved = doubles
    field = jv.piv(frames, pairs="AB", frame_rate=10.0, pair_time=1e-3, scale=1e-4, window=24, step=24)
    np.testing.assert_allclose(field.t, [0.5e-3, 0.1005, 0.2005], atol=1e-12)
    assert abs(float(field.u.median()) / (moved[0] * 1e-4 / 1e-3) - 1.0) < 0.02
    found = jv.piv(frames, pairs="AB", ensemble=3, window=24, step=12)
    assert found.sizes["t"] == 1
    for got, true, sigma in ((found.u, moved[0], found.u_sigma), (found.v, -moved[1], found.v_sigma)):
        good = got.values[found.chc.values > 0]
        tolerance = 4.0 * float(np.nanmedian(sigma)) / np.sqrt(good.size / 4) + 0.01  # px: drawing, as test_piv
        assert good.size > 0.8 * got.size and abs(np.median(good) - true) < tolerance
    mixed = jv.piv(frames, ensemble=3, window=24, step=12)  # every frame with the next
    assert abs(float(mixed.u.isel(t=0).median()) - moved[0]) > 0.1  # px
    for n, keys, said in (
        (6, {"pairs": "AB", "frame_rate": 10.0}, "pair_time: missing"),
        (6, {"pairs": "AB", "frame_rate": 10.0, "pair_time": 0.2}, "must be in"),
        (5, {"pairs": "AB"}, "5 frames; one has no partner"),
        (6, {"pairs": "ab"}, 'must be "each"'),
        (6, {"pair_time": 0.1}, "only of double exposures"),
    ):
        with pytest.raises(InputError, match=said):
            jv.piv(frames[:n], **keys)


def test_export_writes_what_other_programs_read(rotation, tmp_path):
    """The legacy format by VTK's own reader."""
    vtk = pytest.importorskip("vtkmodules.vtkIOLegacy", reason="vtk is not installed: pip install vtk")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    a, b, _ = rotation
    field = jv.piv(a, b, window=24, step=8)
    up = field.sortby("y")
    stack = jv.piv(np.array([a, b, a]), window=24, step=8)
    made = jv.export(stack, str(tmp_path / "new" / "s.vtk"))
    assert [f.name for f in made] == ["s_0000.vtk", "s_0001.vtk", "s.vtk.series"]
    assert [f["time"] for f in json.loads(made[-1].read_text())["files"]] == [0.5, 1.5]
    reader = vtk.vtkStructuredPointsReader()
    reader.ReadAllScalarsOn()
    reader.ReadAllVectorsOn()
    reader.SetFileName(str(made[0]))
    reader.Update()
    image = reader.GetOutput()
    seen = {name: vtk_to_numpy(image.GetPointData().GetArray(name)) for name in ("u", "u_sigma", "reason", "velocity")}
    assert image.GetOrigin()[:2] == (float(up.x[0]), float(up.y[0])) and image.GetSpacing()[:2] == (8.0, 8.0)
    for name in ("u", "u_sigma", "reason"):
        np.testing.assert_array_equal(seen[name].reshape(up.u.shape), up[name].values)
    np.testing.assert_array_equal(seen["velocity"][:, 1], up.v.values.ravel())
    assert vtk_to_numpy(image.GetFieldData().GetArray("TIME")).tolist() == [0.5]
    (table,) = field.jv.export(tmp_path / "x.csv")
    rows = pd.read_csv(table)
    assert list(rows.columns[:4]) == ["y_px", "x_px", "u_px_frame", "v_px_frame"]
    np.testing.assert_allclose(rows.u_px_frame.to_numpy().reshape(field.u.shape), field.u, rtol=1e-12)
    (back,) = jv.export(field, tmp_path / "x.nc")
    np.testing.assert_allclose(jv.flow(back).vorticity.isel(t=0), jv.flow(field).vorticity, rtol=1e-12)
    for given, file, said in ((field, "x.png", "'.png' is no format of fields"), (a, "x.csv", "a ndarray; give a")):
        with pytest.raises(InputError, match=said):
            jv.export(given, tmp_path / file)
    held = field.isel(x=0).to_dataframe()[["u", "v"]].reset_index()
    pd.testing.assert_frame_equal(pd.read_csv(jv.export(held, tmp_path / "p.csv")[0]), held)


def test_a_plot_shows_the_field(rotation):
    a, b, true = rotation
    field = jv.piv(np.array([a, b, b]), window=24, step=8, scale=1e-4)
    axis = field.jv.plot()  # where most moves
    (arrows,) = (c for c in axis.collections if type(c).__name__ == "Quiver")
    good = field.isel(t=0).sortby("y").where(field.chc.isel(t=0) > 0)
    for shown, values in ((arrows.U, good.u.values), (arrows.V, good.v.values)):
        np.testing.assert_allclose(np.sort(shown), np.sort(values[np.isfinite(values)]))
    assert axis.get_xlabel() == "x [mm]" and arrows.colorbar.ax.get_ylabel() == "speed [m/frame]"
    assert "t = 0.5 frame" in axis.get_title() and "t = 1.5 frame" in jv.plot(field, "u", t=2.0).get_title()
    axis = jv.plot(field, "vorticity")
    (seen,) = (c for c in axis.collections if type(c).__name__ == "QuadMesh")
    assert abs(float(np.nanmedian(seen.get_array())) / true - 1.0) < 0.02
    low, high = seen.get_clim()
    assert low == -high and seen.colorbar.ax.get_ylabel() == "vorticity [1/frame]"
    with pytest.raises(InputError, match="did you mean 'vorticity'"):
        field.jv.plot("vortcity")


def test_files_of_other_programs_and_wrong_calls(real_data):
    file, about = real_data / "vector_files" / "openpiv_interTest.txt", {"length": "px", "speed": "px/frame"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert np.isfinite(jv.flow(file, frame_rate=500.0, **about).vorticity).mean() > 0.3
    for given, keys, said in (
        (file, {}, "length: the file has no units"),
        (file, {"lenght": "px"}, "lenght: unknown"),
        (np.zeros((4, 5)), {}, "a ndarray; give what jv"),
    ):
        with pytest.raises(InputError, match=said):
            jv.flow(given, **keys)
