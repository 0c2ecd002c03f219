"""jumpvision figures: what is drawn is what the files hold; sizes, colours and files fit for print."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from test_report import KINDS, campaign_of, diagnosis_of, grains_into

import jumpvision
from jumpvision.cli import main
from jumpvision.experiment.campaign.folder import jumps_table, write_jumps
from jumpvision.experiment.results import fields
from jumpvision.films.vision.piv.pair import MASKED, REASONS
from jumpvision.report.catalogue import available
from jumpvision.report.figures.flows import worst_and_shares
from jumpvision.report.figures.grains import band, busiest
from jumpvision.report.style import ACCENT, COLUMN, GREEN, MAP, MEASURED, MODEL, PAGE, kind_of, lettered, printed, save
from jumpvision.report.style import KINDS as LOOKS
from jumpvision.sweeps.figures import of_folder

POINT = 25.4 / 72  # mm
PACKAGE = Path(jumpvision.__file__).parent


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


def test_no_letter_is_drawn_that_print_fonts_lack():
    """Arial, Helvetica and their like have no small digits below the line: those are set by mathtext."""
    drawing = [*(PACKAGE / "report" / "figures").glob("*.py"), *(PACKAGE / "sweeps").glob("*figure*.py")]
    assert len(drawing) > 10
    assert [f.name for f in drawing if re.search("[\u2080-\u209c]", f.read_text(encoding="utf-8"))] == []


@pytest.mark.long
def test_every_figure_is_as_wide_as_a_column_or_a_page(drawn):
    figures, folder = drawn
    assert sorted(f.stem for f in folder.iterdir()) == sorted(figures) and len(figures) == 8
    for f in folder.iterdir():
        box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)", f.read_bytes())
        width, height = (float(v) * POINT for v in box.groups())
        assert min(abs(width - COLUMN), abs(width - PAGE)) < 0.1 and height < 170.0, f.name


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
    np.testing.assert_allclose(axis.lines[0].get_ydata(), 0.4 * 5.0 * np.arange(12))  # g m/s
    meshes = [m for a in figures["grain-speed"].axes for m in a.collections if m.get_array() is not None]
    np.testing.assert_allclose(meshes[0].get_array(), 0.3 / 0.4)  # of the foot's speed, downwards
    axis = figures["added-mass"].axes[0]
    z = np.array(axis.lines[-1].get_xdata()) * 1e-3
    assert axis.lines[-1].get_ydata()[0] == 0.0
    # eq. (33) as the fit states it: dm/dz at the surface is the slope, 2 kg/m
    assert axis.lines[-1].get_ydata()[1] * 1e-3 / z[1] == pytest.approx(2.0, rel=0.02)


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


def lab(colours):
    from matplotlib.colors import to_rgb
    from skimage.color import rgb2lab

    return rgb2lab(np.array([to_rgb(c) for c in colours])[None])[0]


# Machado, Oliveira, Fernandes 2009, severity 1, on linear RGB
DEUTAN = np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]])
PROTAN = np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]])


@pytest.mark.parametrize("sight", [np.eye(3), DEUTAN, PROTAN], ids=["usual", "deutan", "protan"])
def test_colours_are_told_apart_by_every_sight(sight):
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb

    def seen(colours):
        linear = np.array([to_rgb(c) for c in colours])
        linear = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
        out = np.clip(linear @ sight.T, 0, 1)
        return np.where(out <= 0.0031308, 12.92 * out, 1.055 * out ** (1 / 2.4) - 0.055)

    found = lab(seen([MEASURED, MODEL, GREEN, ACCENT]))
    apart = [float(np.linalg.norm(a - b)) for i, a in enumerate(found) for b in found[:i]]
    assert min(apart) > 10.0  # CIELAB: 2.3 is just noticed, 10 is seen at a glance; marks and lines differ besides
    for name in (MAP, "inferno"):
        light = lab(seen(colormaps[name](np.linspace(0, 1, 64))[:, :3]))[:, 0]
        assert np.diff(light).min() > -0.3 and np.ptp(light) > 60  # lighter is more, in grey too


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--only", "hights"], "did you mean"),
        (["--format", "jpg"], "--format jpg: not one of pdf, svg, png"),
    ],
)
def test_a_wrong_call_is_refused_with_the_remedy(results, tmp_path, given, said, capsys):
    assert main(["figures", str(results), *given, "--out", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_nothing_to_draw_is_said(tmp_path, capsys):
    assert main(["figures", str(tmp_path)]) == 2
    assert "jumpvision run" in capsys.readouterr().err
    assert main(["figures", str(tmp_path / "none")]) == 2
    (tmp_path / "sweep.nc").write_bytes(b"not a field")
    assert main(["figures", str(tmp_path / "sweep.nc")]) == 2
    assert "not a NetCDF file" in capsys.readouterr().err


def told(axis, which):
    """Whether an axis has its name, or a panel that shares it has, or its ticks are words."""
    shares = getattr(axis, f"get_shared_{which}_axes")().get_siblings(axis)
    ticks = [t.get_text() for t in getattr(axis, f"{which}axis").get_ticklabels()]
    return any(getattr(a, f"get_{which}label")() for a in shares) or any(re.search("[a-z]{4}", t) for t in ticks)


def test_every_panel_has_its_letter_every_axis_its_name_and_every_line_its_legend(results, sweep):
    seen = 0
    for name, draw in {**{n: o.draw for n, o in available(results).items()}, **of_folder(sweep)}.items():
        with printed() as Figure:
            figure = lettered(draw(Figure))
        panels = [a for a in figure.axes if not hasattr(a, "_colorbar")]
        if len(panels) > 1:
            assert [a.get_title(loc="left")[:3] for a in panels] == [f"({c})" for c in "abcdefghi"[: len(panels)]]
        legends = [t.get_text() for a in panels if a.get_legend() for t in a.get_legend().get_texts()]
        for axis in panels:
            assert told(axis, "x") and told(axis, "y"), (name, axis.get_title(loc="left"))
            assert set(axis.get_legend_handles_labels()[1]) <= set(legends), name
            seen += 1
    assert seen > 15


def test_a_kind_of_jump_has_one_look_on_paper_and_on_pages(results, drawn):
    handles, labels = drawn[0]["heights"].axes[0].get_legend_handles_labels()
    shown = {label: handle.lines[0].get_color() for handle, label in zip(handles, labels)}
    assert shown == {kind: kind_of(kind).color for kind in KINDS}
    film = drawn[0]["grain-momentum"].axes[0].lines[0]
    assert film.get_color() == kind_of("stutter").color
    assert len({k.color for k in LOOKS.values()} | {kind_of("unheard of").color}) == len(LOOKS) + 1


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
