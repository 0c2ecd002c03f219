"""What every study may be asked that jumps may: limits, other measurements, laws, derivatives of its own."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from scipy.stats import norm

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.engine.detect import LEVEL, POWER
from jumpvision.engine.document.measured import CONTRADICT
from tests.worlds.falls import SIGMA, T, fall, falls, study


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


def test_what_a_study_cannot_have_is_refused():
    with pytest.raises(InputError, match="'h' is no parameter that is fitted"):
        study(measured=[jv.Measured.of("h", 1.0, 0.1, "a ruler")])
    with pytest.raises(InputError, match="'start' is fitted to each recording"):
        jv.Study(fall, [jv.Parameter("start", 0.1, sigma=0.1, each=True)], inputs={"u": (0, 1)})


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
        assert found.lacks[f"x_{law}"] in found.sentence
    else:
        assert {d.mechanism for d in found.detectable} == {"damping", "x_scale", "x_delay", "x_rate", "x_zero"}
        assert not any(n.startswith("x_") for n in asked(consider=()).lacks)


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


def test_the_page_of_a_study_shows_every_recording_and_how_its_parameters_correlate(tmp_path):
    """Of four falls: their traces with the errors that the figures state. Correlations are those of J^T J, with g's
    flat prior over its range, 2 m/s^2, far wider than the falls tell."""
    measured = [jv.Measured.of("g", 9.81, 0.01, "a free swing")]
    found = jv.diagnose(falls(3, c=0.3, n=4), study(measured=measured), results=tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert found.named == ("drag",) and found.sentence in page and "a free swing" in page
    figures = re.findall(
        r"<figcaption>(fall \d)</figcaption><p class=\"note\">([^<]*)</p>.*?<svg .*?</svg>", page, re.S
    )
    assert {name for name, _ in figures} == {f"fall {k}" for k in range(4)}
    for name, note in figures:
        trace = next(x for x in found.traces if x.recording == name)
        assert f"{np.sqrt(np.mean((trace.measured - trace.simulated) ** 2)):.3g}" in note
        rest = trace.measured - trace.extended
        assert np.sqrt(np.mean(rest**2)) == pytest.approx(SIGMA, rel=4 / math.sqrt(2 * T.size))
    design = np.stack([0.5 * T**2, -(T**3)], axis=1)
    covariance = np.linalg.inv(4.0 * design.T @ design / SIGMA**2 + np.diag([1.0 / 0.01**2, 0.0]))
    true = covariance[0, 1] / math.sqrt(covariance[0, 0] * covariance[1, 1])
    assert found.correlations["g"]["c"] == found.correlations["c"]["g"] == pytest.approx(true, abs=0.01)


def slopes(p, r):
    return {"g": 0.5 * r.t**2, "c": -(r.t**3)}


def wrong(p, r):
    return {"g": 0.4 * r.t**2, "c": -(r.t**3)}


def test_own_derivatives_take_the_place_of_differences():
    """The model is linear in both parameters: the same fit to rounding, from fewer runs."""
    recordings = falls(3, c=1.0)
    plain, own = jv.diagnose(recordings, study()), jv.diagnose(recordings, study(jacobian=slopes))
    assert own.named == plain.named == ("drag",) and not own.doubts and own.runs.made < plain.runs.made
    for n, x in own.fitted.items():
        assert x.value == pytest.approx(plain.fitted[n].value, abs=1e-3 * x.sigma)
        assert x.sigma == pytest.approx(plain.fitted[n].sigma, rel=1e-4)


def test_an_attribute_of_the_function_and_other_processes_do_as_well(monkeypatch):
    recordings = falls(3, c=1.0)
    own = jv.diagnose(recordings, study(jacobian=slopes))
    there = jv.diagnose(recordings, study(jacobian=slopes), workers=1)
    assert there.runs.made == own.runs.made and there.sentence == own.sentence
    monkeypatch.setattr(fall, "jacobian", slopes, raising=False)
    assert jv.diagnose(recordings, study()).runs.made == own.runs.made


def test_a_wrong_derivative_is_said_with_its_place_and_not_used():
    """0.4 t^2 for 0.5 t^2: farthest apart at the end of the record, 0.395 s."""
    recordings = falls(3, c=1.0)
    found = jv.diagnose(recordings, study(jacobian=wrong))
    (doubt,) = found.doubts
    assert doubt.kind == "wrong jacobian" and doubt.names == ("g",)
    end = recordings[0].t[-1] ** 2
    assert f"by 'g' is {0.4 * end:.4g}, a difference's {0.5 * end:.4g} (recording 'fall 0', t = 0.395 s" in doubt.words
    plain = jv.diagnose(recordings, study())
    assert found.fitted["g"].value == pytest.approx(plain.fitted["g"].value, abs=1e-3 * plain.fitted["g"].sigma)


def test_what_cannot_have_derivatives_or_has_another_shape_is_refused():
    with pytest.raises(InputError, match="jacobian: it knows no laws"):
        study(jacobian=slopes, symbols={"v": 1.0})
    with pytest.raises(InputError, match="jacobian of 'g' of shape"):
        jv.diagnose(falls(3), study(jacobian=lambda p, r: {"g": np.zeros(3)}))


def test_a_jax_function_is_differentiated_by_jax():
    jax = pytest.importorskip("jax", reason="jax is not installed")
    jax.config.update("jax_enable_x64", True)

    def traced(p, r):
        t = jax.numpy.asarray(r.t)
        return 0.5 * p["g"] * t**2 - p["c"] * t**3

    def leaves(p, r):
        return jax.numpy.asarray(0.5 * float(p["g"]) * r.t**2 - float(p["c"]) * r.t**3)

    recordings = falls(3, c=1.0)
    plain, own = jv.diagnose(recordings, study()), jv.diagnose(recordings, study(traced))
    assert own.named == ("drag",) and own.runs.made < plain.runs.made and not own.doubts
    assert own.fitted["c"].value == pytest.approx(plain.fitted["c"].value, abs=1e-3 * plain.fitted["c"].sigma)
    assert jv.diagnose(recordings, study(leaves)).runs.made == plain.runs.made  # what JAX cannot follow
