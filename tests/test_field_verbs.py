"""`jv.flow`, `statistics`, `export`, `plot` of velocity fields, and double exposures, against known truth.

Truth: exact velocities (a solid rotation, a shear) with Gaussian errors of a known size, and particles drawn as
Gaussian spots at exact places. Nothing here comes from the code under test.
"""

from __future__ import annotations

import json
import os
import warnings
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import jumpvision as jv
from jumpvision.base.schema import InputError

matplotlib.use("Agg")
H, W = 120, 152
REAL = os.environ.get("JUMPVISION_REAL_DATA", "none")


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


TURN, RATE, SIGMA = 3.0, 8.0, 1e-4  # 1/s, 1/s, m/s
FLOWS = {
    "rotation": ((lambda x, y: -TURN * y, lambda x, y: TURN * x), (2 * TURN, 0.0, 0.0, TURN)),
    "shear": ((lambda x, y: RATE * y, lambda x, y: 0.0 * x), (-RATE, 0.0, RATE / np.sqrt(2), 0.0)),
    "stretching": ((lambda x, y: RATE * x, lambda x, y: 0.0 * y), (0.0, RATE, RATE / np.sqrt(2), 0.0)),
}


@pytest.mark.parametrize("kind", FLOWS)
def test_derivatives_of_exact_flows(kind):
    """Plane fits of linear flows have no bias: the values scatter about the truth as their sigmas say."""
    (u, v), (vorticity, divergence, shear_rate, swirl) = FLOWS[kind]
    found = jv.flow(drawn(u, v, sigma=SIGMA), window=1.0)
    for name, true in (("vorticity", vorticity), ("divergence", divergence), ("shear_rate", shear_rate)):
        if name == "shear_rate" and true == 0.0:
            continue  # it is never negative: noise lifts it
        pull = ((found[name] - true) / found[f"{name}_sigma"]).values[1:-1, 1:-1]
        independent = pull.size / 9  # planes through 3 x 3 vectors share them
        assert abs(pull.mean()) < 3.5 / np.sqrt(independent), name
        assert abs(np.sqrt(np.mean(pull**2)) - 1.0) < 3.5 / np.sqrt(2 * independent), name
    if swirl:
        assert abs(float(found.swirl.mean()) - swirl) < 0.01 * swirl
    assert found.vorticity.attrs["units"] == "1/s" and set(found.vorticity.dims) == {"y", "x", "t"}


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


def test_statistics_of_a_known_turbulence():
    """Fluctuations of 0.02 m/s, the noise of 0.005 m/s taken out; means and stresses as their sigmas say."""
    n, fluctuation, noise = 200, 0.02, 0.005
    field = drawn(lambda x, y: 0.3 + 0 * x, lambda x, y: -TURN * x, sigma=noise, times=n, seed=2)
    rng = np.random.default_rng(3)
    for name in "uv":
        field[name] = field[name] + rng.normal(0.0, fluctuation, field[name].shape)
    mean = jv.statistics(field, window=1.0)
    true_v = -TURN * np.broadcast_to(field.x, mean.v.shape)
    for found, true, sigma in (
        (mean.u, 0.3, mean.u_sigma),
        (mean.v, true_v, mean.v_sigma),
        (mean.uu, fluctuation**2, mean.uu_sigma),
        (mean.uv, 0.0, mean.uv_sigma),
    ):
        pull = ((found - true) / sigma).values
        assert abs(pull.mean()) < 4.0 / np.sqrt(pull.size) + 0.15  # a stress of 200 has a skew of sqrt(8/200)
        assert abs(pull.std() - 1.0) < 0.15
    assert abs(float(mean.tke.mean()) / fluctuation**2 - 1.0) < 3.5 / np.sqrt(n * mean.u.size / 2) + 0.01
    one_by_one = jv.statistics([field.isel(t=k) for k in range(n)], window=1.0)
    for name in ("u", "v", "uu", "vv", "uv", "n", "vorticity"):
        np.testing.assert_allclose(one_by_one[name], mean[name], rtol=1e-9, atol=1e-12)
    with pytest.raises(InputError, match="a mean needs 10"):
        jv.statistics(field.isel(t=slice(0, 9)))
    with pytest.raises(InputError, match="field 1 has its vectors elsewhere"):
        jv.statistics([field.isel(t=0), field.isel(t=1, x=slice(1, None))])


@pytest.fixture(scope="module")
def doubles():
    """A1, B1, A2, B2, A3, B3: from A to B all move by (1.7, -0.6) px, from B to the next A by (0.3, 0.5) px."""
    at, moved, between = seeded(np.random.default_rng(5), 600), np.array([1.7, -0.6]), np.array([0.3, 0.5])
    places = [at + k * (moved + between) + b * moved for k in range(3) for b in (0, 1)]
    return np.array([spots(p) for p in places]), moved


def test_double_exposures_are_matched_with_their_own_partner(doubles):
    """Within what the sigmas say of a median; with B1 to A2 among the pairs that are matched together it is far off."""
    frames, moved = doubles
    field = jv.piv(frames, pairs="AB", window=24, step=12)
    assert field.sizes["t"] == 3 and field.t.values.tolist() == [0.5, 2.5, 4.5]
    together = jv.piv(frames, pairs="AB", ensemble=3, window=24, step=12)
    assert together.sizes["t"] == 1
    for found in (field, together):
        for got, true, sigma in ((found.u, moved[0], found.u_sigma), (found.v, -moved[1], found.v_sigma)):
            good = got.values[found.chc.values > 0]
            tolerance = 4.0 * float(np.nanmedian(sigma)) / np.sqrt(good.size / 4) + 0.01  # px: drawing, as test_piv
            assert good.size > 0.8 * got.size and abs(np.median(good) - true) < tolerance
    mixed = jv.piv(frames, ensemble=3, window=24, step=12)  # every frame with the next
    assert abs(float(mixed.u.isel(t=0).median()) - moved[0]) > 0.1  # px


def test_the_clock_of_double_exposures(doubles):
    frames, moved = doubles
    field = jv.piv(frames, pairs="AB", frame_rate=10.0, pair_time=1e-3, scale=1e-4, window=24, step=24)
    np.testing.assert_allclose(field.t, [0.5e-3, 0.1005, 0.2005], atol=1e-12)
    assert abs(float(field.u.median()) / (moved[0] * 1e-4 / 1e-3) - 1.0) < 0.02
    with pytest.raises(InputError, match="pair_time: missing"):
        jv.piv(frames, pairs="AB", frame_rate=10.0)
    with pytest.raises(InputError, match="must be in"):
        jv.piv(frames, pairs="AB", frame_rate=10.0, pair_time=0.2)
    with pytest.raises(InputError, match="5 frames; one has no partner"):
        jv.piv(frames[:5], pairs="AB")
    with pytest.raises(InputError, match='must be "each"'):
        jv.piv(frames, pairs="ab")
    with pytest.raises(InputError, match="only of double exposures"):
        jv.piv(frames, pair_time=0.1)


def test_a_scale_that_is_none_is_refused(rotation):
    with pytest.raises(InputError, match=r"scale = 0.5: must be a number in \(0, 0.01\]"):
        jv.piv(*rotation[:2], scale=0.5)


def test_the_length_over_which_errors_are_correlated_says_so(rotation):
    field = jv.piv(*rotation[:2], window=24, step=8)
    assert "error_px" not in field.attrs
    assert abs(field.attrs["error_correlation_length_px"] - 17.7) < 1.0  # px: measured, docs/stages/piv.md


def legacy(file: Path) -> tuple[dict[str, np.ndarray], list[float], list[float], float]:
    """A reader of VTK's legacy format by its description: arrays, origin, spacing, time."""
    data, at, arrays = file.read_bytes(), 0, {}

    def line() -> str:
        nonlocal at
        end = data.index(b"\n", at)
        text, at = data[at:end].decode(), end + 1
        return text

    kinds = {"double": ">f8", "float": ">f4", "char": ">i1", "int": ">i4"}
    assert line() == "# vtk DataFile Version 3.0"
    line()
    assert [line(), line()] == ["BINARY", "DATASET STRUCTURED_POINTS"]
    nx, ny, _ = map(int, line().split()[1:])
    origin, spacing = ([float(v) for v in line().split()[1:]] for _ in range(2))
    assert [line(), line()] == ["FIELD FieldData 1", "TIME 1 1 double"]
    (time,) = np.frombuffer(data, ">f8", 1, at)
    at += 9
    assert line() == f"POINT_DATA {nx * ny}"
    while at < len(data):
        what, name, kind, *_ = line().split()
        parts = 3 if what == "VECTORS" else 1
        if what == "SCALARS":
            assert line() == "LOOKUP_TABLE default"
        values = np.frombuffer(data, kinds[kind], nx * ny * parts, at)
        at += values.nbytes + 1
        arrays[name] = values.reshape(ny, nx, parts).squeeze()
    return arrays, origin, spacing, float(time)


def test_export_writes_what_other_programs_read(rotation, tmp_path):
    a, b, _ = rotation
    field = jv.piv(a, b, window=24, step=8)
    assert jv.export(field, tmp_path / "new" / "x.vtk") == [tmp_path / "new" / "x.vtk"]
    arrays, origin, spacing, time = legacy(tmp_path / "new" / "x.vtk")
    up = field.sortby("y")
    assert time == 0.5 and origin[:2] == [float(up.x[0]), float(up.y[0])] and spacing[:2] == [8.0, 8.0]
    for name in ("u", "v", "u_sigma", "chc", "reason"):
        np.testing.assert_array_equal(arrays[name], up[name].values)
    np.testing.assert_array_equal(arrays["velocity"][..., 1], up.v.values)
    stack = jv.piv(np.array([a, b, a]), window=24, step=8)
    made = jv.export(stack, str(tmp_path / "s.vtk"))
    assert [f.name for f in made] == ["s_0000.vtk", "s_0001.vtk", "s.vtk.series"]
    assert [f["time"] for f in json.loads(made[-1].read_text())["files"]] == [0.5, 1.5]
    np.testing.assert_array_equal(legacy(made[1])[0]["u"], stack.isel(t=1).sortby("y").u.values)
    (table,) = field.jv.export(tmp_path / "x.csv")
    rows = pd.read_csv(table)
    assert list(rows.columns[:4]) == ["y_px", "x_px", "u_px_s", "v_px_s"]
    np.testing.assert_allclose(rows.u_px_s.to_numpy().reshape(field.u.shape), field.u, rtol=1e-12)
    (back,) = jv.export(field, tmp_path / "x.nc")
    np.testing.assert_allclose(jv.flow(back).vorticity.isel(t=0), jv.flow(field).vorticity, rtol=1e-12)
    assert [f.suffix for f in jv.export(stack, tmp_path / "p.pvd")] == [".pvd", ".vti", ".vti"]
    with pytest.raises(InputError, match=r"'.png' is no format of fields; allowed: .vtk, .pvd"):
        jv.export(field, tmp_path / "x.png")
    with pytest.raises(InputError, match="a ndarray; give a field"):
        jv.export(a, tmp_path / "x.csv")
    held = field.isel(x=0).to_dataframe()[["u", "v"]].reset_index()
    pd.testing.assert_frame_equal(pd.read_csv(jv.export(held, tmp_path / "p.csv")[0]), held)


def test_a_plot_shows_the_field(rotation):
    a, b, true = rotation
    field = jv.piv(a, b, window=24, step=8, scale=1e-4)
    axis = field.jv.plot()
    (arrows,) = (c for c in axis.collections if type(c).__name__ == "Quiver")
    good = field.sortby("y").where(field.chc > 0)
    np.testing.assert_allclose(np.sort(arrows.U), np.sort(good.u.values[np.isfinite(good.u.values)]))
    assert axis.get_xlabel() == "x [mm]" and arrows.colorbar.ax.get_ylabel() == "speed [m/s]"
    axis = jv.plot(field, "vorticity")
    (seen,) = (c for c in axis.collections if type(c).__name__ == "QuadMesh")
    assert abs(float(np.nanmedian(seen.get_array())) / true - 1.0) < 0.02
    low, high = seen.get_clim()
    assert low == -high and seen.colorbar.ax.get_ylabel() == "vorticity [1/s]"
    stack = jv.piv(np.array([a, b, b]), window=24, step=8)
    assert "t = 0.5 s" in jv.plot(stack).get_title()  # where most moves
    assert "t = 1.5 s" in jv.plot(stack, "u", t=2.0).get_title()
    with pytest.raises(InputError, match="did you mean 'vorticity'"):
        field.jv.plot("vortcity")


def test_files_of_other_programs_and_wrong_calls():
    folder = Path(REAL) / "vector_files"
    if not folder.exists():
        pytest.skip("needs JUMPVISION_REAL_DATA's vector files")
    for name, about in {
        "openpiv_interTest.txt": {"length": "px", "speed": "px/frame", "frame_rate": 500.0},
        "insight_Run000001.vec": {},
        "davis8_decimal_comma_B00001.txt": {},
    }.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = jv.flow(folder / name, **about)
        assert np.isfinite(found.vorticity).mean() > 0.3, name
    with pytest.raises(InputError, match="length: the file has no units"):
        jv.flow(folder / "openpiv_interTest.txt")
    with pytest.raises(InputError, match="lenght: unknown"):
        jv.flow(folder / "openpiv_interTest.txt", lenght="px")
    with pytest.raises(InputError, match="a ndarray; give what jv"):
        jv.flow(np.zeros((4, 5)))
