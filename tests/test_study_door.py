"""What every study may be asked that jumps may: limits, other measurements; small systems with known answers."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.stats import norm

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.engine.detect import LEVEL, POWER
from jumpvision.engine.document.measured import CONTRADICT

T = np.arange(80) / 200
SIGMA = 1e-3  # m


def fall(p, r):
    return 0.5 * p["g"] * r.t**2 - p.get("c", 0.0) * r.t**3


def falls(seed, g=9.81, c=0.0, n=3):
    """Heights fallen [m], as the integral of the speed g t - 3 c t^2 over the steps of the record."""
    rng, (gauss, weight) = np.random.default_rng(seed), np.polynomial.legendre.leggauss(3)
    inner = np.concatenate([[0.0], np.diff(T)])[:, None] * (gauss - 1) / 2 + T[:, None]
    y = np.cumsum(np.concatenate([[0.0], np.diff(T)]) / 2 * ((g * inner - 3 * c * inner**2) @ weight))
    return [jv.Recording(f"fall {k}", T, y + SIGMA * rng.standard_normal(T.size)) for k in range(n)]


def study(**more):
    drag = jv.Mechanism("drag", [jv.Parameter("c", 0.0, (-5, 5), unit="m/s^3")], "the drag of the air")
    given = {"mechanisms": [drag], "channels": [jv.Channel("y", "m", noise=SIGMA, consider=())], **more}
    return jv.Study(fall, [jv.Parameter("g", 9.8, (9, 11))], **given)


def test_what_could_be_hidden_is_told_of_a_study_too():
    """The least strength by the normal equations: sigma of c beside a fitted g, times the limit of the test at its
    level and power; the noise is stated to 5 %, which widens the limit by less than that."""
    found = jv.diagnose(falls(1), study())
    (limit,) = found.detectable
    design = np.stack([0.5 * T**2, -(T**3)], axis=1) / SIGMA
    sigma = math.sqrt(np.linalg.inv(3 * design.T @ design)[1, 1])
    z = norm.isf(LEVEL / 4) + norm.ppf(POWER)
    assert found.adequate and limit.mechanism == "drag" and limit.unit == "m/s^3"
    assert limit.value == pytest.approx(z * sigma, rel=0.05)
    assert f"c = {limit.value:.3g} m/s^3" in found.explain("drag") and found.explain("drag").endswith(".")


@pytest.mark.parametrize(("off", "apart"), [(0.5, False), (6.0, True)])
def test_other_measurements_are_taken_in_and_contradictions_said(off, apart, tmp_path):
    sigma = 0.01  # m/s^2, of both: the falls tell g to 0.5 mm/s^2
    measured = [jv.Measured.of("g", 9.81 + off * sigma, sigma, "a free swing")]
    found = jv.diagnose(falls(2), study(measured=measured, mechanisms=[]))
    (row,) = found.confirmation
    assert row.contradicts == apart == (abs(row.z) > CONTRADICT) and row.source == "a free swing"
    design = 0.5 * T**2 / SIGMA
    assert row.by_jumps_sigma == pytest.approx(1 / math.sqrt(3 * design @ design), rel=0.02)
    assert row.by_jumps == pytest.approx(9.81, abs=4 * row.by_jumps_sigma)
    if apart:
        assert "g is 9.87 ± 0.01 by a free swing" in found.confirmed and "by the recordings alone" in found.confirmed
    else:
        assert found.confirmed is None and found.fitted["g"].sigma < row.by_jumps_sigma
    found.save(tmp_path)
    assert json.loads((tmp_path / "diagnosis.json").read_text())["confirmation"][0]["verdict"] == row.verdict


def test_a_measurement_of_nothing_is_refused():
    with pytest.raises(InputError, match="'h' is no parameter that is fitted"):
        study(measured=[jv.Measured.of("h", 1.0, 0.1, "a ruler")])


def coast(p, r, force):
    """Speed of a coasting body by Runge-Kutta of the fourth order, a step a sample."""
    h, v, out = T[1], r.inputs["start"], []
    for _ in r.t:
        out.append(v)
        a = force(v=v)
        b = force(v=v + h / 2 * a)
        c = force(v=v + h / 2 * b)
        v += h / 6 * (a + 2 * b + 2 * c + force(v=v + h * c))
    return np.array(out)


def test_a_law_that_no_mechanism_of_a_study_is_is_found():
    """v' = -k |v|^1.5 has the closed solution (|v0|^-1/2 + k t / 2)^-2; only a constant force is on the list."""
    rng, k, size = np.random.default_rng(4), 1.2, 2.0
    runs = []
    for start in (4.0, -3.0, 2.0, -1.0):
        v = np.sign(start) * (abs(start) ** -0.5 + 0.5 * k * T) ** -2
        runs.append(jv.Recording(f"from {start}", T, v + SIGMA * rng.standard_normal(T.size), {"start": start}))
    tilt = jv.Mechanism("tilt", [jv.Parameter("a", 0.0, (-5, 5))], law="-a")
    asked = jv.Study(coast, [], [tilt], [jv.Channel("v", "m/s", noise=SIGMA)], symbols={"v": size}, force=2.0)
    found = jv.diagnose(runs, asked)
    law = found.discovered
    assert found.named == () and found.status == "complete" and law.r2 > 0.99
    assert law.law == "-r * sign(v) * abs(v / 2)**p" and set(law.parameters) == {"r", "p"}
    for name, true in (("p", 1.5), ("r", k * size**1.5)):
        assert abs(law.parameters[name].value - true) < 4 * law.parameters[name].sigma < 0.05 * true
    assert law.law in found.sentence and "no mechanism of the study explains" in found.sentence
    assert found.gain.ratio > 10 and found.extended_model.parameters["power_v_p"] == law.parameters["p"].value
    assert np.std(np.concatenate([x.measured - x.extended for x in found.traces])) < 1.2 * SIGMA


def braked(p, r, force):
    return coast(p, r, lambda v: force(v=v) - p["c"] * v)


def test_a_weak_law_that_few_recordings_show_is_told_and_none_is_set_aside():
    """v' = -c v - k |v| v, closed: v = c v0 e / (c + k |v0| (1 - e)), e = exp(-c t). Beside a fitted c the fast runs
    show k, by less than would halve the error; r is k v^2 at the typical size."""
    rng, c, k, size = np.random.default_rng(6), 0.8, 0.004, 2.0
    runs = []
    for start in (0.3, -0.5, 0.7, -0.9, 1.4, -2.0, 2.6, -3.0):
        e = np.exp(-c * T)
        v = c * start * e / (c + k * abs(start) * (1 - e))
        runs.append(jv.Recording(f"from {start}", T, v + SIGMA * rng.standard_normal(T.size), {"start": start}))
    tilt = jv.Mechanism("tilt", [jv.Parameter("a", 0.0, (-5, 5))], law="-a")
    free = [jv.Parameter("c", 0.7, (0, 3))]
    asked = jv.Study(braked, free, [tilt], [jv.Channel("v", "m/s", noise=SIGMA)], symbols={"v": size}, force=2.0)
    found = jv.diagnose(runs, asked)
    law = found.discovered
    assert law is not None and law.law == "-r * sign(v) * abs(v / 2)**p" and not found.varies and not found.named
    for name, true in (("p", 2.0), ("r", k * size**2)):
        assert abs(law.parameters[name].value - true) < 4 * law.parameters[name].sigma
    assert abs(found.fitted["c"].value - c) < 4 * found.fitted["c"].sigma
    assert 1.2 < found.gain.ratio < 2.0  # which the law's former first strength, 0, made 1


LONG = np.arange(100) / 50


def shaken(p, r):
    """x'' = -W (x - 0.1 cos 5 t) - c x' by leapfrog, 2 ms."""
    h, x, v, out = 2e-3, r.inputs["start"], 0.0, []
    for t in LONG:
        out.append(x)
        for k in range(10):
            x += h / 2 * v
            v += h * (p["W"] * (0.1 * math.cos(5 * (t + (k + 0.5) * h)) - x) - p["c"] * v)
            x += h / 2 * v
    return np.array(out)


@pytest.mark.parametrize(
    ("law", "true"), [("delay", 0.008), ("scale", 1.03), ("rate", 4e-3), ("zero", 2e-3), ("", 0.0)]
)
def test_faults_of_the_instrument_are_tried_unasked(law, true):
    """Readings by the closed solution (W = 60, no damping): scale x(t + rate t - delay) + zero, by 8 ms, 3 %, 0.4 %,
    2 mm beside noise of 0.5 mm; none of them, and none with consider=(), is named."""
    rng, w, runs = np.random.default_rng(8), math.sqrt(60), []
    at = LONG * (1 + (true if law == "rate" else 0)) - (true if law == "delay" else 0)
    forced = 0.1 * 60 / (60 - 25)
    for start in (0.1, 0.2, -0.3):
        x = forced * np.cos(5 * at) + (start - forced) * np.cos(w * at)
        x = x * (true if law == "scale" else 1) + (true if law == "zero" else 0)
        runs.append(jv.Recording(f"from {start}", LONG, x + 5e-4 * rng.standard_normal(100), {"start": start}))
    cause = jv.Mechanism("damping", [jv.Parameter("c", 0.0, (0, 3), scale=0.1)])

    def asked(**more):
        channels = [jv.Channel("x", "m", noise=5e-4, **more)]
        return jv.diagnose(runs, jv.Study(shaken, [jv.Parameter("W", 58.0, (30, 90))], [cause], channels))

    found = asked()
    assert found.named == ((f"x_{law}",) if law else ()) and found.adequate == (law == "")
    if law:
        value = found.fitted[f"x_{law}"]
        assert abs(value.value - true) < 4 * value.sigma < 0.2 * abs(true) and found.status == "complete"
        assert found.lacks[f"x_{law}"] in found.sentence and not any(
            n.startswith("x_") for n in asked(consider=()).lacks
        )
    else:
        assert {d.mechanism for d in found.detectable} == {"damping", "x_scale", "x_delay", "x_rate", "x_zero"}


def pulled(p, r):
    """A line whose slope is an input u; two causes are alike but for a bump of one about u = 2.5."""
    u = r.inputs["u"]
    return (p["g"] * u**2 + p["a"] * u + p["b"] * (u + 3 * math.exp(-(((u - 2.5) / 0.3) ** 2)))) * r.t


def test_the_inputs_that_tell_two_causes_apart_are_proposed():
    """Measured where both causes do the same: of the nine values from 0 to 4 only 2.5 tells them apart."""
    rng = np.random.default_rng(5)
    runs = [
        jv.Recording(f"u = {u}", T, (u**2 + 0.2 * u) * T + SIGMA * rng.standard_normal(T.size), {"u": u})
        for u in (0.5, 1.0, 1.5)
    ]
    causes = [jv.Mechanism(n, [jv.Parameter(n, 0.0, (-1, 1))]) for n in ("a", "b")]
    given = [jv.Parameter("g", 1.0, (0.5, 2))], causes, [jv.Channel("y", "m", noise=SIGMA)]
    found = jv.diagnose(runs, jv.Study(pulled, *given, inputs={"u": (0.0, 4.0)}))
    best = found.next_experiment
    assert set(found.indistinguishable[0]) == {"a", "b"} and set(best.separates) == {"a", "b"}
    assert best.inputs == {"u": 2.5} and best.words == "u = 2.5" and best.expected_log10_odds > 10
    assert found.values["next_experiment"]["frequency"] is None and len(found.traces) == 3
    assert jv.diagnose(runs, jv.Study(pulled, *given)).next_experiment is None


def test_inputs_of_a_recording_that_is_fitted_for_itself_are_refused():
    with pytest.raises(InputError, match="'start' is fitted to each recording"):
        jv.Study(fall, [jv.Parameter("start", 0.1, sigma=0.1, each=True)], inputs={"u": (0, 1)})


def test_the_page_of_a_study_holds_what_the_verdict_rests_on(tmp_path):
    """Causes in the study's words, limits, other measurements and parameters, as of a campaign."""
    measured = [jv.Measured.of("g", 9.81, 0.01, "a free swing")]
    found = jv.diagnose(falls(6, c=0.4), study(measured=measured), results=tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert found.named == ("drag",) and "the drag of the air" in page and found.sentence in page
    for text in ("Mechanisms and their parameters", "by the recordings alone", "a free swing", "simulations made"):
        assert text in page
    assert "nan" not in page.split("<main>")[1].split("base64")[0].lower()


def test_what_is_left_is_told_by_recording_time_and_state():
    """A push that nobody lists, on the last third of one of four lines, where y is highest: at least nine tenths of the
    excess of chi^2 are there (noise makes of 320 readings 25 of chi^2, the push more than 2,000)."""
    rng, runs = np.random.default_rng(12), []
    for k in range(4):
        y = (1.0 + 0.1 * k) * T + SIGMA * rng.standard_normal(T.size)
        y += (k == 2) * 0.02 * np.sin(40 * np.maximum(T - 0.27, 0.0))
        runs.append(jv.Recording(f"line {k}", T, y, {"slope": 1.0 + 0.1 * k}))
    asked = jv.Study(
        lambda p, r: p["g"] * r.inputs["slope"] * r.t,
        [jv.Parameter("g", 1.0, (0.5, 2))],
        [jv.Mechanism("bend", [jv.Parameter("b", 0.0, (-1, 1))], function=lambda p, r: p["g"] * r.t + p["b"] * r.t**2)],
        [jv.Channel("y", "m", noise=SIGMA, consider=())],
    )
    found = jv.diagnose(runs[1:3], asked)
    where = found.left_over.where
    assert "in line 2, " in where and "in the last third of the records" in where and "where y is above 0.3" in where
    each = [float(x.split(" %")[0]) for x in where.split(", ")]
    assert len(each) == 3 and min(each) > 90 and where in found.sentence


def test_the_page_of_a_study_shows_every_recording_in_its_own_words(tmp_path):
    """Of four falls: measured, simulated and what is left, with their errors; no word of sand."""
    import re

    found = jv.diagnose(falls(3, c=0.3, n=4), study(), results=tmp_path)
    page = (tmp_path / "report.html").read_text()
    figures = re.findall(
        r"<figcaption>(fall \d)</figcaption><p class=\"note\">([^<]*)</p>.*?(<svg .*?</svg>)", page, re.S
    )
    assert {name for name, *_ in figures} == {f"fall {k}" for k in range(4)}
    for name, note, svg in figures:
        said = re.findall(r"<text[^>]*>([^<]*)</text>", svg)
        assert {"y [m]", "measured − simulated [m]", "measured", "simulated", "extended"} <= set(said)
        trace = next(x for x in found.traces if x.recording == name)
        assert f"{np.sqrt(np.mean((trace.measured - trace.simulated) ** 2)):.3g}" in note
        rest = trace.measured - trace.extended
        assert np.sqrt(np.mean(rest**2)) == pytest.approx(SIGMA, rel=4 / math.sqrt(2 * T.size))
    assert "hear rate" not in page and "its unit" not in page and "heights, residuals" not in page


def test_correlations_of_parameters_are_those_of_the_normal_equations(tmp_path):
    """g and c of a fall: of J^T J, with g's flat prior over its range, 2 m/s^2, far wider than the falls tell."""
    found = jv.diagnose(falls(3, c=0.3, n=4), study())
    design = np.stack([0.5 * T**2, -(T**3)], axis=1)
    covariance = np.linalg.inv(design.T @ design)
    true = covariance[0, 1] / math.sqrt(covariance[0, 0] * covariance[1, 1])
    assert found.named == ("drag",) and found.correlations["g"]["c"] == pytest.approx(true, abs=0.01)
    assert found.correlations["c"]["g"] == found.correlations["g"]["c"]
    assert found.correlations["g"]["g"] == pytest.approx(1.0)
