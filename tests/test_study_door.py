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
    given = {"mechanisms": [drag], "channels": [jv.Channel("y", "m", noise=SIGMA)], **more}
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


def test_the_page_of_a_study_shows_every_recording_in_its_own_words(tmp_path):
    """Of four falls: measured, simulated and what is left, as data for the page's script; no word of sand."""
    import re

    found = jv.diagnose(falls(3, c=0.3, n=4), study(), results=tmp_path)
    page = (tmp_path / "report.html").read_text()
    charts = [json.loads(x) for x in re.findall(r'<script type="application/json">(.*?)</script>', page, re.S)]
    assert {c["title"] for c in charts} == {f"fall {k}" for k in range(4)}
    for c in charts:
        whole, left = c["panels"]
        assert whole["y"] == {"label": "y", "unit": "m"} and [s["name"] for s in left["series"]] == [
            "simulated",
            "extended",
        ]
        by_name = {s["name"]: np.array(s["y"], float) for s in whole["series"]}
        trace = next(x for x in found.traces if x.recording == c["title"])
        for name in ("measured", "simulated", "extended"):
            np.testing.assert_allclose(by_name[name], getattr(trace, name), rtol=1e-4, atol=1e-12)
        rest = np.array(left["series"][1]["y"], float)
        assert np.sqrt(np.mean(rest**2)) == pytest.approx(SIGMA, rel=4 / math.sqrt(2 * T.size))
        assert f"{np.sqrt(np.mean((trace.measured - trace.simulated) ** 2)):.3g}" in c["note"]
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
