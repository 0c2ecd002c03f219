"""The pages people read: numbers as in the files, one self-contained page each, alive in a real browser."""

from __future__ import annotations

import gc
import json
import math
import re
import time
import tracemalloc
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pint
import pytest
import xarray as xr
from diagnosis_sample import confirmation, diagnosis
from hypothesis import given
from hypothesis import strategies as st

from jumpvision.base.arrays import measured, plain_number
from jumpvision.base.storage import write_aside
from jumpvision.engine.document.values import Baseline, Cause, Cell, Gain, Height, Noise, NoiseSource, Parameter
from jumpvision.estimate.estimate import Estimate
from jumpvision.experiment.campaign.folder import jumps_table
from jumpvision.experiment.files import REPORT
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.experiment.results.fields import Column, ColumnGeometry
from jumpvision.experiment.results.summary import UNKNOWN, JumpRow, Summary, Uncertain
from jumpvision.experiment.results.values import Fits
from jumpvision.experiment.workflow.run import Outcome
from jumpvision.experiment.workflow.workspace import Step
from jumpvision.films.grains.grid import VectorGrid
from jumpvision.jumper.question.jumps import PARTS
from jumpvision.report.figures.diagnosis import beyond, gains
from jumpvision.report.figures.overlays import STRIP, ConeDrawing, webm
from jumpvision.report.pages import report
from jumpvision.report.pages.page import GAINS
from jumpvision.report.pages.quantities import UNITS, fit_rows, shown_in, small, typeset
from jumpvision.report.pages.report import write_report
from jumpvision.report.pages.svg import INK, drawing
from jumpvision.report.pages.words import OTHERS, campaign_words, experiment_words
from jumpvision.report.style import MEASURED, styled

FILED = {  # units in fits.json and intrusion.json
    "added_mass_kg": "kg", "actuator_lag_s": "s", "actuator_tau_s": "s", "volume_m3": "m3", "frequency_hz": "Hz",
    "delta": "m", "k1": "N/m", "k2": "N/m",
}  # fmt: skip
KINDS = {"single": (0.040, 0.042), "stutter": (0.020, 0.034)}  # measured and simulated height [m]
SENTENCE = "The simulation over-predicts stutter jumps by 14.0 ± 0.1 mm because it lacks: added mass."


def png(shape=(90, 120), seed=0) -> bytes:
    import cv2

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
        where=(
            Cell("stutter", "landing", -0.006, 9.0, 1e-5, 40),
            Cell("single", "flight", 0.001, 9.0, 0.3, 40),
        ),
        causes=(Cause("added_mass", (), 0.97, (0.9, 0.99), 812.3, {"C": Parameter(2.7, 2.4, 3.0, "1")}),),
        gain=Gain(tuple(h.experiment for h in heights), 0.0099, 0.0003, 0.008, 0.0002, 43.0, (34.0, 53.0), True),
    )


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    campaign, outcomes, results = campaign_of(folder, picture=png())
    grains_into(outcomes[1].results)
    rows = jumps_table(campaign, outcomes)
    outcomes[0].steps.append(
        Step(
            "track",
            "computed",
            0.0,
            [{"kind": "frames", "message": "<script>alert(1)</script>", "recording": "", "values": {}}],
            "",
            {},
            {},
        )
    )
    write_report(campaign, outcomes, rows, results, single=False, diagnosis=diagnosis_of(rows))
    return results


def drawings(page):
    """The figures of a page, by what they show."""
    found = re.findall(r"<svg .*?</svg>", page.read_text(encoding="utf-8"), re.S)
    return {x.get("aria-label"): x for x in map(ElementTree.fromstring, found)}


# --- what is in the pages --------------------------------------------------------------------------------------------


def test_points_read_as_the_table_and_open_the_pages_of_their_experiments(pages):
    text = (pages / REPORT).read_text(encoding="utf-8")
    table = dict(re.findall(r'<td><a href="[^"]*">([^<]*)</a></td>\n?<td>([^<]*)</td>|$', text)[:4])
    heights = drawings(pages / REPORT)["Jump heights"]
    links = [(a.get("href"), a.find("title").text.partition(", simulated")[0]) for a in heights.iter("a")]
    assert sorted(table) == ["single-0", "single-2", "stutter-1", "stutter-3"]
    # once against frequency, once against the model
    assert sorted(links) == sorted(2 * [(f"{n}/{REPORT}", f"{n}: {h} mm") for n, h in table.items()])
    assert all((pages / href).exists() for href, _ in links)


def test_a_map_reads_its_values(pages):
    """Where the model fails, by kind and part of the jump: the cells of diagnosis_of."""
    said = [t.text for t in drawings(pages / REPORT)[GAINS].iter("title")]
    assert said[-2:] == ["stutter, landing: -6 mm", "single, flight: 1 mm"]


def test_the_pages_show_what_was_measured(pages):
    shown = drawings(pages / "stutter-1" / REPORT)
    assert [*shown] == [
        "The jump", "Momentum of the grains", "Mass that moves with the foot", "The central column and the cone",
    ]  # fmt: skip
    said = {e.text for e in shown["The jump"].iter("text")}
    assert {"measured", "model", "rod height [mm]", "measured − model [mm]", "time [s]", " motor"} <= said
    assert [*drawings(pages / "single-0" / REPORT)] == ["The jump"]


def test_ids_of_a_page_are_its_own_and_stand_once(pages):
    for page in pages.rglob(REPORT):
        text = page.read_text(encoding="utf-8")
        ids = re.findall(r'\sid="([^"]+)"', text)
        asked = set(re.findall(r'href="#([^"]+)"', text)) | set(re.findall(r"url\(#([^)]+)\)", text))
        assert len(ids) == len(set(ids)) and asked <= set(ids), page


def test_the_first_screen_says_the_verdict_and_three_numbers(pages):
    text = (pages / REPORT).read_text(encoding="utf-8")
    assert re.search(r"<h1[^>]*>" + re.escape(SENTENCE) + "</h1>", text)
    assert re.findall(r"<dd>([^<]*)", text) == ["9.9 ", "43×", "4 "]
    said, facts = experiment_words(
        None, Summary("", jump_height=Uncertain(0.02, 2e-5), simulated_height=0.0345), Fits({})
    )
    assert said == "A jump rose 20.000 ± 0.020 mm; the model says 34.5 mm, 14.5 mm too high."
    assert [f[0] for f in facts] == ["20.000 ± 0.020", "+14.5"]
    said, facts = experiment_words(
        None, Summary("", jump_height=Uncertain(0.02, 2e-5), simulated_height=0.01999), Fits({})
    )
    assert said.endswith("the model says 19.99 mm, the same within 2σ.") and facts[1][0] == "−0.010 ± 0.020"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("mu = -1.2 (-1.3 to -1.1), theta = 1.05", "μ = −1.2 (−1.3 to −1.1), θ = 1.05"),
        ("dg = -0.4916 m/s^2, 4.86e+03 N/m^3, 1.03e-05 s", "dg = −0.4916 m/s², 4.86 × 10³ N/m³, 1.03 × 10⁻⁵ s"),
        ("beta [deg]", "β [°]"),
        ("true phi", "true φ"),
        ("jump-2, theta-3, mu_cone, alphabet, 2e", "jump-2, theta-3, mu_cone, alphabet, 2e"),  # names stay
    ],
)
def test_a_table_is_typeset(text, shown):
    assert typeset(text) == shown == typeset(shown)


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (2.01e-4, "kg", "201 mg"),
        (0.0312, "kg", "31.2 g"),
        (1.03e-5, "s", "10.3 μs"),
        (0.00198, "N", "1.98 mN"),
        (4860.0, "N/m^3", "4860 N/m³"),
        (0.00331, "N s/m", "0.00331 N s/m"),
        (2.5e7, "N/m^3", "2.5 × 10⁷ N/m³"),
    ],
)
def test_a_strength_is_said_in_the_unit_of_its_size(value, unit, shown):
    assert small(value, unit) == shown


def test_half_a_foot_is_said_where_its_mass_stands():
    mass = Fits({"added_mass_kg": Estimate(0.073, 0.001, "kg", 7, math.nan)})
    assert [experiment_words(None, UNKNOWN, mass, whole=w)[1][0][2] for w in (False, True)] == [
        "grains that move with the foot, at most (half foot, as filmed; the whole foot moves twice as much, 146 g)",
        "grains that move with the foot, at most (whole foot)",
    ]


@pytest.mark.parametrize(
    ("true", "said"),
    # C = 2.7, 90 % from 2.4 to 3.0: sigma 0.3 / 1.645 = 0.182, 95 % to 3.057; by film 2.6 ± 0.1, 95 % to 2.796
    [(2.75, ("C = 2.75; all inside 95 %", "inside 95 %")),
     (3.03, ("C = 3.03; all inside 95 %", "outside 95 % (4.3 σ) by film")),
     (3.10, ("C = 3.10; C outside 95 % (2.2 σ)", "outside 95 % (5.0 σ) by film; outside 95 % (2.0 σ) by"))],
)  # fmt: skip
def test_the_truth_stands_beside_the_named_parameters_only_where_it_is_stated(tmp_path, true, said):
    campaign, outcomes, results = campaign_of(tmp_path)
    rows = jumps_table(campaign, outcomes)
    recorded = write_report(campaign, outcomes, rows, results, single=False, diagnosis=diagnosis_of(rows)).read_text()
    assert "Measured by films or tests" in recorded and "2.60 ± 0.10" in recorded and "−0.4" in recorded
    assert ">true<" not in recorded and "95 %" not in recorded
    truth = {"terms": ["added_mass"], "parameters": {"C": true}}
    (campaign.path / "truth.json").write_text(json.dumps(truth))  # the page is made anew though no result changed
    text = write_report(campaign, outcomes, rows, results, single=False, diagnosis=diagnosis_of(rows)).read_text()
    assert len(re.findall(">true<", text)) == 2
    model, film = said
    assert f'<td class="words">{model}</td>' in text and f"<td>{film}" in text


def test_the_extended_model_is_drawn_against_the_apex_that_it_was_fitted_to():
    """The highest jump may come before the motor's stop, which the diagnosis does not count: 20 mm, later 18 mm."""
    tops = tuple(Height(str(k), "single", 5.0 + k, 0.0, None, 0.018, 2e-5, 0.025, 0.0181) for k in range(2))
    with styled() as Figure:
        model, better, *_ = gains(diagnosis(heights=tops), Figure).axes[0].lines
    assert (list(model.get_xdata()), list(model.get_ydata())) == ([25.0, 25.0], [18.0, 18.0])
    assert (list(better.get_xdata()), list(better.get_ydata())) == ([18.1, 18.1], [18.0, 18.0])


def test_the_noise_stands_with_its_sources_and_its_warnings_at_the_head(tmp_path):
    campaign, outcomes, results = campaign_of(tmp_path)
    rows = jumps_table(campaign, outcomes)
    found = diagnosis_of(rows)
    warning = "the noise is 0.08 mm in flight but 0.05 mm at rest"
    found = replace(found, noise=replace(found.noise, warnings=(warning,)))
    text = write_report(campaign, outcomes, rows, results, single=False, diagnosis=found).read_text()
    assert "Noise: 0.05 mm a frame; at rest 0.0500 ± 0.0010 mm (n = 950)." in text  # 2 % of 0.05 mm; the others unknown
    assert warning in text[: text.index("</header>")]


def test_every_page_stands_alone(pages):
    found = sorted(pages.rglob(REPORT))
    assert len(found) == 5
    for page in found:
        text = page.read_text(encoding="utf-8")
        assert not re.search(r'(src|href|url)\s*[=(]\s*["\']?(https?:)?//', text)
        local = set(re.findall(r'(?:src|href)="(?!data:|#)([^"$]*)"', text))
        assert all((page.parent / link).exists() for link in local), local
        assert "<script>alert" not in text


def test_the_campaigns_page_does_not_hold_the_experiments_pictures(tmp_path, monkeypatch):
    """Page and memory with 16 experiments and with 4: a row and its height more, not a picture of 300 kB."""
    picture, size, peak = png((330, 310)), {}, {}
    written = report._experiment

    def freed(*args, **named):
        gc.collect()  # matplotlib's figures are circles of references, which Python else frees in its own time
        return written(*args, **named)

    monkeypatch.setattr(report, "_experiment", freed)
    for n in (4, 16):
        campaign, outcomes, results = campaign_of(tmp_path / str(n), n, picture)
        rows = jumps_table(campaign, outcomes)
        write_report(
            campaign, outcomes[:1], rows, results / "warm", single=False
        )  # imports and templates are not counted
        tracemalloc.start()
        write_report(campaign, outcomes, rows, results, single=False)
        peak[n] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        size[n] = (results / REPORT).stat().st_size
    assert len(picture) > 300_000
    assert size[16] - size[4] < 12 * 1000
    assert peak[16] - peak[4] < len(picture)


def test_pages_are_written_again_only_where_results_changed(tmp_path):
    campaign, outcomes, results = campaign_of(tmp_path)
    rows = jumps_table(campaign, outcomes)

    def written():
        write_report(campaign, outcomes, rows, results, single=False)
        return {p.parent.name: p.stat().st_mtime_ns for p in results.rglob(REPORT)}

    first, again = written(), written()
    assert first == again
    write_aside(outcomes[2].results / "provenance.json", json.dumps({"outputs": {"rod.csv": "other"}}))
    changed = written()
    assert {n for n in first if first[n] != changed[n]} == {"single-2", "results"}
    outcomes[3].errors.append("rod.avi: truncated")
    assert written()["stutter-3"] != first["stutter-3"]
    assert "rod.avi: truncated" in (results / REPORT).read_text()


def test_the_cone_film_shows_shear_where_it_is_below_the_foot():
    scale, n = 1e-3, 3
    x, y = np.arange(-40, 41, 4) * 1e-3, np.arange(-76, 1, 4) * 1e-3
    shear = np.zeros((y.size, x.size, n))
    strong = np.abs(x + 0.020) < 0.003  # a band 20 mm left of the axis
    shear[:, strong] = 10.0
    coords = {"x": x, "y": y, "t": np.arange(n) * 0.01}
    field = xr.Dataset({"foot_y": ("t", np.full(n, -0.030))}, coords=coords)
    grid = VectorGrid(delta_t=0.01, source="drawn", scale_m_per_px=scale, origin_column_px=45.0, origin_row_px=2.0,
                      window_px=4, step_px=4, error_correlation_length_px=4,
                      image_rows=80, image_columns=92)  # fmt: skip
    rate = xr.DataArray(shear, dims=("y", "x", "t"), coords=coords)
    draw = ConeDrawing(field, grid, rate, None, np.tile(np.uint8([0, 200]), (80, 46)), scale)
    picture = draw(np.zeros((80, 92), np.uint8), 1)[:-STRIP].astype(int)
    row, column = np.nonzero(picture[..., 2] > 120)  # red: nothing else has it
    # grid of 4 mm with linear interpolation: half of the band's weight lies within 2 mm of its middle
    assert (column.mean() + 0.5) / draw.zoom - 0.5 == pytest.approx(45 - 20, abs=0.5)
    assert np.ptp(column) / draw.zoom < 8.0
    assert (row.min() + 0.5) / draw.zoom - 0.5 >= 2 + 30 - 0.6  # nothing above the foot's face


@given(
    st.floats(-1e6, 1e6),
    st.floats(-6, 5).map(lambda e: 10.0**e),
)
def test_a_value_stands_with_the_two_figures_that_its_uncertainty_is_worth(value, sigma):
    said, width = measured(value, sigma).split(" ± ")
    step = 10.0 ** (int(f"{sigma:.1e}".partition("e")[2]) - 1)  # of the second figure of the rounded sigma
    assert abs(float(said) - value) <= 0.5001 * step + 1e-12 * abs(value)
    assert abs(float(width) - sigma) <= 0.5001 * step
    assert "e" not in said and not said.startswith("-0.0 ")
    assert len(width.lstrip("0.").rstrip("0").replace(".", "")) <= 2  # no third figure
    assert [len(x.partition(".")[2]) for x in (said, width)] == [max(0, -round(math.log10(step)))] * 2


@pytest.mark.parametrize(
    ("value", "said"),
    [(1234.0, "1234"), (0.5, "0.5000"), (12345.6, "12346"), (0.0, "0.000"), (9.5e-103, "9.500e-103"), (None, "")],
)
def test_a_value_without_uncertainty_has_four_figures(value, said):
    assert plain_number(value) == said


def test_fits_stand_in_words_units_and_digits():
    given = {"n_jumps": Estimate(2.0, 0.0, "", 2, 0.0), "added_mass_kg": Estimate(0.0732, 0.0004, "kg", 9, 1.0),
             "decay_viscous_p_value": Estimate(6.8e-95, math.nan, "", 9, 1.0),
             "jump_height_m": Estimate(0.03999551924317099, 2.34e-5, "m", 9, 1.0),
             "mu": Estimate(math.nan, math.nan, "", 0, math.nan, "no front")}  # fmt: skip
    assert [r[:3] for r in fit_rows(given)] == [
        ("flights of the jump", "2", ""), ("greatest added mass (half foot, as filmed)", "73.20 ± 0.40", "g"),
        ("p of viscous damping alone", "< 0.0001", ""),
        ("jump height above rest", "39.996 ± 0.023", "mm"),
    ]  # fmt: skip
    assert "(whole foot)" in fit_rows(given, whole=True)[1].name


def test_a_campaigns_sentence_says_on_which_side_the_model_lies():
    """3 mm above the measured heights at every jump, then 2 mm below them."""
    for off, said in ((3e-3, "the model is 3 mm higher on average"), (-2e-3, "the model is 2 mm lower on average")):
        jumps = [Summary("", jump_height=Uncertain(h, 1e-5), simulated_height=h + off) for h in (0.030, 0.035, 0.041)]
        rows = [JumpRow(str(k), kind="single", summary=jumped) for k, jumped in enumerate(jumps)]
        text, facts = campaign_words(rows, None, None, 0)
        assert said in text and facts[-1] == (f"{1e3 * abs(off):.3g}", "mm", "model against measured, rms")


def test_a_pages_units_are_those_of_the_files_times_their_factors():
    """One of each unit in fits.json is the factor of the page's unit, by a library of units; so are a mass in g, a lag
    in ms and what stands at the head of a page."""
    convert = pint.UnitRegistry()

    def si(unit):
        return unit.replace("m3", "m^3").replace("°", "degree").replace("³", "^3").replace("²", "^2")

    fits = {n: (u, *shown_in(n, u)) for n, u in FILED.items()}
    heads = {name: (FILED[name], unit, factor) for name, _, unit, factor in OTHERS if unit}
    every = [*((u, *shown) for u, shown in UNITS.items()), *fits.values(), *heads.values()]
    for filed, shown, factor in every:
        assert convert(si(filed)).to(si(shown)).magnitude == pytest.approx(factor), (filed, shown)
    assert fit_rows({"volume_m3": Estimate(8.8e-7, 2e-9, "m3", 9, 1.0)})[0][1:3] == ("0.8800 ± 0.0020", "cm³")


@pytest.mark.parametrize(("found", "dots"), [(0, 0), (1, 1), (3, 3), (4, 0), (6, 0)])
def test_cells_are_marked_only_where_few_are_beyond_chance(found, dots):
    cells = tuple(Cell("single", p, 0.001, 9.0, 1e-4 if k < found else 0.5, 40) for k, p in enumerate(PARTS[:6]))
    with styled() as Figure:
        where = gains(diagnosis(where=cells), Figure).axes[1]
    assert len(beyond(cells)) == len(where.lines) == dots
    assert where.get_xlabel() == ("a dot: beyond chance" if dots else f"{found} of 6 beyond chance")


def test_a_drawing_has_the_pages_ink_and_no_paper():
    def draw(Figure):
        figure = Figure()
        figure.subplots().plot([0, 1], color=MEASURED, label="line")
        return figure

    made = drawing("a line", draw)
    assert made.startswith("<svg") and INK not in made and MEASURED.lower() not in made
    assert "currentColor" in made and "var(--measured)" in made and "#ffffff" not in made


# --- in a browser ----------------------------------------------------------------------------------------------------


@pytest.fixture
def open_page(browser):
    """Opens a page; at the end nothing may have been said on the console and nothing asked from elsewhere."""
    contexts, said = [], []

    def go(file, width=1280, height=800, **options):
        contexts.append(browser.new_context(viewport={"width": width, "height": height}, **options))
        page = contexts[-1].new_page()
        page.on("console", lambda m: said.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda e: said.append(str(e)))
        page.on("request", lambda r: said.append(r.url) if not r.url.startswith(("file:", "data:")) else None)
        page.goto(file.as_uri())
        page.evaluate("document.querySelectorAll('details.fold').forEach(d => d.open = true)")
        return page

    yield go
    for c in contexts:
        c.close()
    assert said == []


def until(page, condition):
    deadline = time.monotonic() + 15.0
    while not page.evaluate(condition):
        assert time.monotonic() < deadline, f"never came true: {condition}"
        page.wait_for_timeout(30)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("which", [REPORT, f"stutter-1/{REPORT}"])
def test_every_figure_fits_at_every_width_and_in_both_schemes(pages, open_page, which, width, scheme):
    page = open_page(pages / which, width, color_scheme=scheme)
    assert page.locator("figure.drawn svg").count() == (2 if which == REPORT else 4)
    assert page.evaluate("document.documentElement.scrollWidth") <= width  # nothing to scroll sideways
    boxes = page.evaluate("[...document.querySelectorAll('.drawn')].map(s => s.getBoundingClientRect().right)")
    assert max(boxes) <= width
    sizes = "[...document.querySelectorAll('.drawn text')].map(t => t.getBoundingClientRect().height)"
    assert min(h for h in page.evaluate(sizes) if h) > 5.0  # px, of the smallest letters: indices of formulas
    paper, ink, dots = page.evaluate(
        "[getComputedStyle(document.body).backgroundColor, getComputedStyle(document.querySelector('.drawn svg')).fill,"
        " getComputedStyle(document.body).getPropertyValue('--measured')]"
    )
    shades = [sum(map(int, re.findall(r"\d+", c))) for c in (paper, ink)]
    assert (shades[0] > 600 > 200 > shades[1]) == (scheme == "light") and (shades[1] > 600) == (scheme == "dark")
    assert dots == {"light": "#0072b2", "dark": "#56b4e9"}[scheme]


def test_pointing_at_a_mark_finds_it_and_a_click_opens_its_experiment(pages, open_page):
    page = open_page(pages / REPORT)
    point = page.locator("a.point", has=page.locator("title", has_text=re.compile("^stutter-3: "))).first
    box = point.bounding_box()
    assert box["width"] > 10  # px: a finger's
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.wait_for_url("**/stutter-3/report.html")


def test_the_films_play_and_print_shows_a_frame(pages, open_page):
    page = open_page(pages / "stutter-1" / REPORT)
    assert page.locator("video").count() == 2
    page.evaluate("document.querySelectorAll('video').forEach(v => v.play())")
    until(page, "[...document.querySelectorAll('video')].every(v => v.videoWidth === 96 && v.currentTime > 0)")
    page.emulate_media(media="print", color_scheme="dark")
    assert page.locator("video").first.is_hidden() and page.locator(".still").first.is_visible()
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert sum(map(int, re.findall(r"\d+", paper))) == 3 * 255


VISIBLE = "document.querySelectorAll('script, pre').forEach(e => e.remove()), document.body.innerText"


@pytest.mark.parametrize("which", [REPORT, f"stutter-1/{REPORT}"])
def test_a_reader_sees_words_and_sensible_digits(pages, open_page, which):
    """No name of a variable, no number as the machine has it: what every reader would trip over."""
    text = open_page(pages / which).evaluate(VISIBLE)
    assert len(text) > 500
    assert not re.findall(r"\b[a-z]+_[a-z_]+\b", text)
    assert not re.findall(r"\d*\.\d{7,}|\d+\.\d+e[+-]?\d+", text)


def test_the_verdict_has_three_levels_and_paper_has_no_folds(pages, browser, tmp_path):
    page = browser.new_page()
    page.goto((pages / REPORT).as_uri())
    assert page.locator("h1").is_visible() and page.locator("figure.drawn").first.is_visible()
    inside = page.locator("details.fold figure.drawn")
    assert inside.count() == 1 and not inside.first.is_visible()
    file = tmp_path / "page.pdf"
    page.pdf(path=file, format="A4")
    assert inside.first.is_visible()  # opened for the paper
    page.close()
    pdfium = pytest.importorskip("pypdfium2", reason="pypdfium2 draws the printed page")
    for sheet in pdfium.PdfDocument(file):
        grey = sheet.render(scale=0.5).to_numpy().min(axis=2)
        assert (grey < 200).mean() > 0.002  # a line of text is 0.003 of a sheet


def test_a_dark_page_is_printed_in_the_colours_of_paper_and_sharp(pages, browser, tmp_path):
    pdfium = pytest.importorskip("pypdfium2", reason="pypdfium2 draws the printed page")
    page = browser.new_page(color_scheme="dark")
    page.goto((pages / "stutter-1" / REPORT).as_uri())
    page.pdf(path=tmp_path / "page.pdf", format="A4")
    page.close()
    sheet = pdfium.PdfDocument(tmp_path / "page.pdf")[0]
    shades = sheet.render(scale=4).to_numpy()[..., ::-1].reshape(-1, 3).astype(int)
    near = [(np.abs(shades - rgb).sum(1) < 9).sum() for rgb in ((0, 114, 178), (86, 180, 233))]
    assert near[0] > 1000 > 10 > near[1]
    text = sheet.get_textpage().get_text_range()
    assert "rod height above rest" in text and "time [s]" in text  # letters, not their outlines


@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        (390, "dark"),
        *(pytest.param(*c, marks=pytest.mark.long) for c in ((390, "light"), (1280, "light"), (1280, "dark"))),
    ],
)
def test_no_finding_of_axe(pages, open_page, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="pip install axe-playwright-python")
    for which in (REPORT, f"stutter-1/{REPORT}"):
        page = open_page(pages / which, width, 800, color_scheme=scheme)
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        page.wait_for_timeout(300)
        found = axe.Axe().run(page).response["violations"]
        assert [(v["id"], [n["html"] for n in v["nodes"]]) for v in found] == []


def test_what_is_named_stands_first_among_the_explanations():
    """Though another leaves less, as one with more parameters does."""
    from types import SimpleNamespace as Said

    from matplotlib.figure import Figure

    from jumpvision.report.figures.diagnosis import _causes

    def tried(name, chi2):
        return Said(mechanisms=(name,), fit=Said(chi2=chi2, residuals=[np.zeros(100)]))

    others = [tried(f"other_{k}", 50.0 + k) for k in range(9)]
    best = tried("dry_friction", 99.0)
    axes = Figure().subplots()
    _causes(axes, Said(naming=Said(tried=(*others, best), best=best, named=("dry_friction",)), problem=None))
    assert next(x.get_text() for x in axes.get_yticklabels()) == "dry friction" and len(axes.patches) == 7


def test_a_long_name_beside_a_bar_is_cut_and_no_mechanism_is():
    from jumpvision.jumper.mechanisms.registry import MECHANISMS
    from jumpvision.report.figures.diagnosis import tick

    assert tick("scale of stutter-5.5Hz-1, stutter-5.5Hz-2 and others") == "scale of stutter-5.5Hz-1, …"
    assert not [m for m in MECHANISMS if "…" in tick(m)]


def test_a_page_counts_the_files_of_a_folder_that_has_many():
    """Its film of pictures has each digest in provenance.json alone: 20,000 lines are read by nobody."""
    from jumpvision.report.pages.page import MANY, _shown

    few = {f"logs/{k}.csv": "0" * 64 for k in range(MANY)} | {"experiment.toml": "1" * 64}
    film = {f"film/{k}.png": "2" * 64 for k in range(MANY + 1)}
    made = {"inputs": few | film, "command": "jumpvision run .", "checksums": {}}
    listed = few | {"film/": f"{MANY + 1} files, each with its SHA-256 in provenance.json"}
    assert _shown(made) == {"inputs": listed, "command": "jumpvision run ."}
    assert _shown({}) == {} and len(made["inputs"]) == len(few) + len(film)
