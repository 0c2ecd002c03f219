"""The pages people read: numbers as in the files, one self-contained page each, alive in a real browser."""

from __future__ import annotations

import json
import math
import re
import time
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pint
import pytest
from diagnosis_sample import diagnosis
from hypothesis import given
from hypothesis import strategies as st

from jumpvision.base.arrays import measured, plain_number
from jumpvision.base.storage import write_aside
from jumpvision.engine.document.values import Height
from jumpvision.estimate.estimate import Estimate
from jumpvision.experiment.campaign.folder import jumps_table
from jumpvision.experiment.files import REPORT
from jumpvision.experiment.results.summary import JumpRow, Summary, Uncertain
from jumpvision.experiment.results.values import Fits
from jumpvision.experiment.workflow.workspace import Step
from jumpvision.report.figures.diagnosis import gains
from jumpvision.report.pages.page import GAINS
from jumpvision.report.pages.quantities import UNITS, fit_rows, shown_in, small, typeset
from jumpvision.report.pages.report import write_report
from jumpvision.report.pages.svg import INK, drawing
from jumpvision.report.pages.words import OTHERS, campaign_words, experiment_words
from jumpvision.report.style import MEASURED, styled
from tests.worlds.pages import SENTENCE, campaign_of, diagnosis_of, grains_into, png

FILED = {  # units in fits.json and intrusion.json
    "added_mass_kg": "kg", "actuator_lag_s": "s", "actuator_tau_s": "s", "volume_m3": "m3", "frequency_hz": "Hz",
    "delta": "m", "k1": "N/m", "k2": "N/m",
}  # fmt: skip


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
    said = [t.text for t in drawings(pages / REPORT)[GAINS].iter("title")]
    assert said[-2:] == ["stutter, landing: -6 mm", "single, flight: 1 mm"]  # where the model fails


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


def test_strengths_units_and_tables_are_typeset():
    """In the unit of the size; names of experiments stay."""
    for value, unit, shown in ((2.01e-4, "kg", "201 mg"), (0.0312, "kg", "31.2 g"), (1.03e-5, "s", "10.3 μs"),
                               (4860.0, "N/m^3", "4860 N/m³"), (0.00331, "N s/m", "0.00331 N s/m"),
                               (2.5e7, "N/m^3", "2.5 × 10⁷ N/m³")):  # fmt: skip
        assert small(value, unit) == shown
    for text, shown in (
        ("mu = -1.2 (-1.3 to -1.1), theta = 1.05", "μ = −1.2 (−1.3 to −1.1), θ = 1.05"),
        ("dg = -0.4916 m/s^2, 4.86e+03 N/m^3, 1.03e-05 s", "dg = −0.4916 m/s², 4.86 × 10³ N/m³, 1.03 × 10⁻⁵ s"),
        ("jump-2, theta-3, mu_cone, alphabet, 2e", "jump-2, theta-3, mu_cone, alphabet, 2e"),
    ):
        assert typeset(text) == shown == typeset(shown)
    for value, said in ((1234.0, "1234"), (0.5, "0.5000"), (12345.6, "12346"), (0.0, "0.000"), (None, "")):
        assert plain_number(value) == said


def test_the_truth_stands_beside_the_named_parameters_only_where_it_is_stated(tmp_path):
    """C = 2.7, 90 % from 2.4 to 3.0: sigma 0.3 / 1.645 = 0.182; by film 2.6 ± 0.1. The truth: 3.1. Beside the noise."""
    campaign, outcomes, results = campaign_of(tmp_path, 2)
    rows = jumps_table(campaign, outcomes)
    found = diagnosis_of(rows)
    found = replace(found, noise=replace(found.noise, warnings=("a warning of the noise",)))
    recorded = write_report(campaign, outcomes, rows, results, single=False, diagnosis=found).read_text()
    assert "2.60 ± 0.10" in recorded and "−0.4" in recorded and "0.0500 ± 0.0010 mm (n = 950)" in recorded
    assert "a warning of the noise" in recorded[: recorded.index("</header>")]
    assert ">true<" not in recorded and "95 %" not in recorded
    truth = {"terms": ["added_mass"], "parameters": {"C": 3.10}}
    (campaign.path / "truth.json").write_text(json.dumps(truth))  # the page is made anew though no result changed
    text = write_report(campaign, outcomes, rows, results, single=False, diagnosis=found).read_text()
    assert len(re.findall(">true<", text)) == 2
    assert "C = 3.10; C outside 95 % (2.2 σ)" in text and "outside 95 % (5.0 σ) by film" in text


def test_the_extended_model_is_drawn_against_the_apex_that_it_was_fitted_to():
    """The highest jump may come before the motor's stop, which the diagnosis does not count: 20 mm, later 18 mm."""
    tops = tuple(Height(str(k), "single", 5.0 + k, 0.0, None, 0.018, 2e-5, 0.025, 0.0181) for k in range(2))
    with styled() as Figure:
        model, better, *_ = gains(diagnosis(heights=tops), Figure).axes[0].lines
    assert (list(model.get_xdata()), list(model.get_ydata())) == ([25.0, 25.0], [18.0, 18.0])
    assert (list(better.get_xdata()), list(better.get_ydata())) == ([18.1, 18.1], [18.0, 18.0])


def test_every_page_stands_alone(pages):
    found = sorted(pages.rglob(REPORT))
    assert len(found) == 5
    for page in found:
        text = page.read_text(encoding="utf-8")
        assert not re.search(r'(src|href|url)\s*[=(]\s*["\']?(https?:)?//', text)
        local = set(re.findall(r'(?:src|href)="(?!data:|#)([^"$]*)"', text))
        assert all((page.parent / link).exists() for link in local), local
        assert "<script>alert" not in text


def test_pages_are_written_again_only_where_results_changed(tmp_path):
    campaign, outcomes, results = campaign_of(tmp_path, 2)
    rows = jumps_table(campaign, outcomes)

    def written():
        write_report(campaign, outcomes, rows, results, single=False)
        return {p.parent.name: p.stat().st_mtime_ns for p in results.rglob(REPORT)}

    first, again = written(), written()
    assert first == again
    write_aside(outcomes[0].results / "provenance.json", json.dumps({"outputs": {"rod.csv": "other"}}))
    changed = written()
    assert {n for n in first if first[n] != changed[n]} == {"single-0", "results"}
    outcomes[1].errors.append("rod.avi: truncated")
    assert written()["stutter-1"] != first["stutter-1"]
    assert "rod.avi: truncated" in (results / REPORT).read_text()


@given(st.floats(-1e6, 1e6), st.floats(-6, 5).map(lambda e: 10.0**e))
def test_a_value_stands_with_the_two_figures_that_its_uncertainty_is_worth(value, sigma):
    said, width = measured(value, sigma).split(" ± ")
    step = 10.0 ** (int(f"{sigma:.1e}".partition("e")[2]) - 1)  # of the second figure of the rounded sigma
    assert abs(float(said) - value) <= 0.5001 * step + 1e-12 * abs(value)
    assert abs(float(width) - sigma) <= 0.5001 * step
    assert "e" not in said and not said.startswith("-0.0 ")
    assert len(width.lstrip("0.").rstrip("0").replace(".", "")) <= 2  # no third figure
    assert [len(x.partition(".")[2]) for x in (said, width)] == [max(0, -round(math.log10(step)))] * 2


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
    """3 mm above the measured heights at every jump, then 2 mm below them; one without a height comes first."""
    for off, said in ((3e-3, "the model is 3 mm higher on average"), (-2e-3, "the model is 2 mm lower on average")):
        jumps = [Summary("", jump_height=Uncertain(h, 1e-5), simulated_height=h + off) for h in (0.030, 0.035, 0.041)]
        lost = Summary("", jump_height=Uncertain(math.nan, math.nan))
        rows = [JumpRow(str(k), kind="single", summary=jumped) for k, jumped in enumerate([lost, *jumps])]
        text, facts = campaign_words(rows, None, None, 0)
        assert said in text and facts[0] == ("41", "mm", "highest jump: 3")
        assert facts[-1] == (f"{1e3 * abs(off):.3g}", "mm", "model against measured, rms")


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


@pytest.mark.parametrize(("which", "width", "scheme"), [(REPORT, 390, "dark"), (f"stutter-1/{REPORT}", 390, "light")])
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
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="pip install axe-playwright-python")
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    found = axe.Axe().run(page).response["violations"]
    assert [(v["id"], [n["html"] for n in v["nodes"]]) for v in found] == []
    page.evaluate("document.querySelectorAll('script, pre').forEach(e => e.remove())")
    text = page.evaluate("document.body.innerText")  # no name of a variable, no number as the machine has it
    assert len(text) > 500 and not re.findall(r"\b[a-z]+_[a-z_]+\b|\d*\.\d{7,}|\d+\.\d+e[+-]?\d+", text)


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


def test_the_verdict_has_three_levels_and_paper_has_no_folds(pages, browser):
    page = browser.new_page()
    page.goto((pages / REPORT).as_uri())
    assert page.locator("h1").is_visible() and page.locator("figure.drawn").first.is_visible()
    inside = page.locator("details.fold figure.drawn")
    assert inside.count() == 1 and not inside.first.is_visible()
    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert inside.first.is_visible()  # opened for the paper
    page.close()


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
