"""jumpvision figures: what is drawn is what the files hold; sizes, colours and files fit for print."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from jumpvision.cli import main
from jumpvision.experiment.campaign.folder import jumps_table, write_jumps
from jumpvision.experiment.results import fields
from jumpvision.films.vision.piv.pair import MASKED, REASONS
from jumpvision.report.catalogue import available
from jumpvision.report.figures.flows import Map, draw_maps, worst_and_shares
from jumpvision.report.figures.grains import band, busiest
from jumpvision.report.style import MEASURED, printed, save
from jumpvision.sweeps.figures import of_folder
from tests.worlds.pages import KINDS, campaign_of, diagnosis_of, grains_into


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    campaign, outcomes, results = campaign_of(folder)
    grains_into(outcomes[1].results)
    rows = jumps_table(campaign, outcomes)
    write_jumps(rows, results)
    diagnosis_of(rows).save(results)
    return results


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    out = tmp_path_factory.mktemp("sweep")
    axes = ["--frequency", "6:10:5", "--phase", "0:6:4"]
    assert main(["sweep", "hard", *axes, "--no-pictures", "--results", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def drawn(results, tmp_path_factory):
    """All figures of the results by name, as saved, and the files."""
    folder, figures = tmp_path_factory.mktemp("pdf"), {}
    for name, (_, _, draw) in available(results).items():
        with printed() as Figure:
            figures[name] = draw(Figure)
            save(figures[name], folder / f"{name}.pdf")
    return figures, folder


def test_a_campaign_an_experiment_and_a_sweep_list_what_they_have(results, sweep, capsys):
    def listed(path):
        assert main(["figures", str(path), "--list", "--json"]) == 0
        return [r["figure"] for r in json.loads(capsys.readouterr().out)]

    grains = ["grain-speed", "shear-rate", "column", "added-mass", "grain-momentum"]
    assert listed(results) == ["heights", "tracks", "diagnosis", *grains]
    assert listed(results / "stutter-1") == ["tracks", *grains]
    assert listed(results / "single-0") == ["tracks"]
    assert listed(sweep) == listed(sweep / "sweep.nc") == ["sweep"]


def test_the_same_results_give_the_same_files(results, sweep, tmp_path):
    for out in ("a", "b"):
        given = ["--only", "grain-momentum", "--format", "pdf,svg", "--format", "png", "--out", str(tmp_path / out)]
        assert main(["figures", str(results), *given]) == 0
    assert main(["figures", str(sweep)]) == 0
    assert [f.name for f in (sweep / "figures").iterdir()] == ["sweep.pdf"]
    made = sorted(f.name for f in (tmp_path / "a").iterdir())
    assert made == ["grain-momentum.pdf", "grain-momentum.png", "grain-momentum.svg"]
    for name in made:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_heights_and_tracks_hold_the_tables(results, drawn):
    figures, _ = drawn
    left, right = figures["heights"].axes
    places = sorted((float(x), float(y)) for line in left.lines for x, y in zip(*line.get_data()) if np.isfinite(y))
    expected = [(f, 1e3 * h) for f in (6.0, 6.5) for kind in KINDS.values() for h in kind]
    np.testing.assert_allclose(sorted({tuple(p) for p in np.round(places, 6).tolist()}), sorted(expected))
    assert {tuple(np.round(np.asarray(line.get_data()[0], float), 6)) for line in right.lines[:-1]} == {
        (42.0, 42.0),
        (34.0, 34.0),
    }
    figure = figures["tracks"]
    lower = figure.axes[2:]
    assert [a.get_title(loc="left") for a in figure.axes[:2]] == ["single-2", "stutter-3"]
    t = pd.read_csv(results / "stutter-3" / "rod.csv").time_s
    np.testing.assert_allclose(lower[1].lines[1].get_ydata(), -14.0 * np.sin(6 * t), atol=1e-9)


def test_the_grains_hold_the_fields(drawn):
    figures, _ = drawn
    axis = figures["grain-momentum"].axes[0]
    # g m/s over ms from where it exceeds 5 % of its peak, the second of the times
    np.testing.assert_allclose(axis.lines[0].get_data(), [2.0 * np.arange(12) - 2.0, 0.4 * 5.0 * np.arange(12)])
    meshes = [m for a in figures["grain-speed"].axes for m in a.collections if m.get_array() is not None]
    np.testing.assert_allclose(meshes[0].get_array(), 0.3 / 0.4)  # of the foot's speed, downwards
    axis = figures["added-mass"].axes[0]
    z = np.array(axis.lines[-1].get_xdata()) * 1e-3
    assert axis.lines[-1].get_ydata()[0] == 0.0
    # eq. (33) as the fit states it: dm/dz at the surface is the slope, 2 kg/m
    assert axis.lines[-1].get_ydata()[1] * 1e-3 / z[1] == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize("unit, factor, shown", [("m", 1e3, "mm"), ("px", 1.0, "px")])
def test_axes_of_maps_say_the_unit_of_their_numbers(unit, factor, shown):
    x, y, shape = np.linspace(0.1, 0.4, 6), np.linspace(0.0, 0.2, 5), (5, 6)
    data = xr.Dataset({k: (("y", "x"), np.ones(shape)) for k in "uv"}, coords={"x": x, "y": y})
    with printed() as Figure:
        figure = Figure(figsize=(4, 4))
        draw_maps(figure, (2, 2), data, unit, [Map("speed", np.ones(shape), "magma")] * 4, "")
    top, _, low, _ = figure.axes[:4]
    assert (low.get_xlabel(), top.get_ylabel()) == (f"x [{shown}]", f"y [{shown}] (up)")
    assert top.get_xlim() == pytest.approx((0.1 * factor, 0.4 * factor)) and top.get_ylim()[1] == 0.2 * factor


def test_of_a_long_field_a_part_of_the_times_is_read_at_once(monkeypatch):
    rng, shape = np.random.default_rng(3), (5, 7, 40)
    made = {k: rng.normal(size=shape) for k in ("u", "v", "u_raw", "v_raw")}
    made["u_raw"][rng.random(shape) < 0.1] = np.nan
    made |= {"chc": rng.integers(-1, 2, shape), "reason": rng.integers(0, len(REASONS), shape)}
    field = xr.Dataset({k: (("y", "x", "t"), v) for k, v in made.items()})
    monkeypatch.setattr(fields, "AT_ONCE", 1)
    worst, measured, shares = worst_and_shares(field)
    share = (made["chc"] > 0).sum((0, 1)) / (made["reason"] != MASKED).sum((0, 1))
    speed = np.nanmean(made["u_raw"] ** 2 + made["v_raw"] ** 2, axis=(0, 1))
    least = np.flatnonzero(share <= share.min() + 1e-9)
    assert worst == least[np.argmax(speed[least])]
    np.testing.assert_allclose(measured, share)
    np.testing.assert_array_equal(shares, [(made["reason"] == k).mean((0, 1)) for k in range(len(REASONS))])
    mean = np.where(made["chc"] > 0, np.hypot(made["u"], made["v"]), np.nan)
    assert busiest(field) == np.argmax(np.nanmean(mean, axis=(0, 1)))


def test_a_band_of_two_sigmas_holds_the_truth_in_95_of_100():
    """Momentum drawn about its truth with the sigma that is told: of 2,000 values 0.9545 +- 4 * 0.0047 in the band."""
    rng, n = np.random.default_rng(6), 2000
    x, sigma = np.arange(n, dtype=float), rng.uniform(0.5, 2.0, n)
    with printed() as Figure:
        axis = Figure(figsize=(3.0, 2.0)).subplots()
        band(axis, x, 3.0 + sigma * rng.standard_normal(n), sigma, MEASURED)
        corners = axis.collections[0].get_paths()[0].vertices
    low, high = ([f(corners[corners[:, 0] == k, 1]) for k in x] for f in (np.min, np.max))
    assert np.mean((np.array(low) < 3.0) & (np.array(high) > 3.0)) == pytest.approx(0.9545, abs=0.019)


def test_no_letter_is_larger_than_seven_points_and_no_label_is_cut_off(drawn):
    from matplotlib.text import Text

    for name, figure in drawn[0].items():
        assert max(t.get_fontsize() for t in figure.findobj(Text)) <= 7.0
        for axis in figure.axes:
            for text in (axis.title, axis._left_title, axis.xaxis.label, axis.yaxis.label):
                if text.get_text():
                    seen, box = text.get_window_extent(), figure.bbox
                    # a pixel for the letters' own overhang
                    assert seen.x0 > -1 and seen.y0 > -1, (name, text.get_text())
                    assert seen.x1 < box.x1 + 1 and seen.y1 < box.y1 + 1, (name, text.get_text())


def test_a_wrong_call_or_nothing_to_draw_is_refused(results, tmp_path):
    (tmp_path / "sweep.nc").write_bytes(b"not a field")
    for given in (["--only", "hights"], ["--format", "jpg"]):
        assert main(["figures", str(results), *given, "--out", str(tmp_path / "out")]) == 2
    for path in (tmp_path, tmp_path / "none", tmp_path / "sweep.nc"):
        assert main(["figures", str(path), "--out", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()


def test_a_sweep_never_replaces_another(tmp_path, capsys):
    def swept(*axes):
        assert main(["sweep", "hard", *axes, "--no-pictures", "--results", str(tmp_path)]) == 0
        return capsys.readouterr().err

    swept("--frequency", "6:10:3")
    assert "kept" not in swept("--frequency", "6:10:3")  # the same once more
    assert "kept as" in swept("--frequency", "6:10:4")
    assert "kept as" in swept("--phase", "0:6:3")
    kept = sorted(f.name for f in tmp_path.glob("sweep-map-frequency-*.nc"))
    assert len(kept) == 2 and (tmp_path / "sweep.nc").exists()
    assert sorted(len(xr.load_dataset(tmp_path / f).frequency) for f in kept) == [3, 4]
    assert {f.removesuffix(".nc") for f in kept} < set(of_folder(tmp_path))
