"""Numbers that were taken for constant: patterns against closed forms, campaigns of a laboratory at fault, own values
of recordings whose chi^2 has more than one minimum."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from shared import SAMPLES

from jumpvision.cli import main
from jumpvision.engine.document.values import Pattern as Kind
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.system import Circumstances, Observation, Parameter
from jumpvision.engine.vary.apart import Apart, apart
from jumpvision.engine.vary.patterns import WIDTHS, Pattern, patterns, scatter, weigh
from jumpvision.engine.vary.variables import LOST, OFFSET, RATE, SCALE, Variable, shown
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.learning import learn_noise
from tests.worlds.faults import truth
from tests.worlds.jumps import diagnose_jumps
from tests.worlds.laboratories import MS10, made

N = 20
NUMBER = Variable("k", 100.0, "N/m", spread=0.1, step=1e-3)
SEED = 6  # of the worlds; no campaign of the published table


def recordings(n: int = N) -> list[Observation]:
    t = np.linspace(0.0, 1.0, 50)
    frequency = [5.0 + (i % 5) for i in range(n)]
    return [
        Observation(
            f"r{i}", t, t, f"r{i}", f"r{i}", labels={"frequency": frequency[i]},
            circumstances=Circumstances(float(i), 60.0 * i, "ab"[i >= 8], {"room_C": 20.0 + 0.1 * i * (-1) ** i}),
        )
        for i in range(n)
    ]  # fmt: skip


def values(change: np.ndarray, sigma: float = 0.01, chi2: float = 0.0) -> Apart:
    """Changes measured independently, each with this sigma."""
    return Apart(NUMBER, change, np.eye(change.size) / sigma**2, chi2, np.zeros(0), ())


def best(found: Apart) -> Pattern:
    return max((weigh(p, found) for p in patterns(found, recordings())), key=lambda w: w.log_evidence).pattern


def test_the_evidence_of_a_pattern_is_that_of_a_normal_model():
    """Against the marginal likelihood of N values, written out: N(0, sigma^2 + width^2 x x')."""
    rng = np.random.default_rng(0)
    change, sigma = 0.05 * rng.standard_normal(N), 0.02
    x = np.linspace(0.0, 1.0, N)[:, None]
    w = weigh(Pattern((NUMBER,), Kind.DRIFT, "order", x), values(change, sigma))
    each = [
        stats.multivariate_normal(cov=sigma**2 * np.eye(N) + (0.1 * f) ** 2 * x @ x.T).logpdf(change) for f in WIDTHS
    ]
    free = stats.norm(scale=sigma).logpdf(np.zeros(N)).sum()  # of values that are as they are measured
    assert w.log_evidence == pytest.approx(max(each) - math.log(len(WIDTHS)) - free, abs=1e-8)


@pytest.mark.parametrize(
    ("kind", "of", "true"),
    [
        (Kind.ODD, None, lambda i: 0.1 * (i == 7)),
        (Kind.STEP, "order", lambda i: 0.05 * (i >= 13)),
        (Kind.STEP, "session", lambda i: 0.05 * (i >= 8)),
        (Kind.DRIFT, "order", lambda i: -0.08 * i / (N - 1)),
        (Kind.FUNCTION, "frequency", lambda i: -0.04 * max(i % 5 - 2.0, 0.0)),
        (Kind.FUNCTION, "room_C", lambda i: 0.03 * 0.1 * i * (-1) ** i),
    ],
)
def test_the_pattern_of_values_is_found(kind, of, true):
    """Sizes of 5 sigma of one value and more. Of 20 draws of noise one value in 20 x 20 lies beyond 3 sigma and may be
    taken for odd beside it: four of them at most (binomial, 2 sigma)."""
    change, more = np.array([true(i) for i in range(N)]), 0
    members = {"order": tuple(range(13, N)), "session": tuple(range(8, N)), None: (7,)}
    for seed in range(20):
        noise = 0.008 * np.random.default_rng(seed).standard_normal(N)
        p = best(values(change + noise, 0.008))
        assert (p.kind, p.of) == (kind, of)
        if kind in (Kind.ODD, Kind.STEP):
            assert set(members[of]) & set(p.members)
            more += p.members != members[of]
    assert more <= 4


def test_scatter_is_measured_and_its_interval_covers():
    """Of 200 draws the 90 % interval holds the true standard deviation in 90 %, within three binomial sigmas."""
    true, sigma, held = 0.03, 0.01, 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        change = true * rng.standard_normal(N) + sigma * rng.standard_normal(N)
        found = scatter(values(change, sigma))
        held += found is not None and found.low <= true <= found.high
    assert abs(held / 200 - 0.9) < 3.0 * math.sqrt(0.9 * 0.1 / 200)


def test_one_value_of_all_recordings_is_no_scatter():
    """A camera whose scale is wrong for all alike, 5 sigma of one recording and 50: noise makes odds of 150 once in 150
    draws or less often (Markov), so of 100 draws at most 4 (binomial, 3 sigma) say that they differ."""
    said = 0
    for seed in range(100):
        noise = 0.01 * np.random.default_rng(seed).standard_normal(N)
        said += scatter(values((0.05 if seed % 2 else 0.5) + noise)) is not None
    assert said <= 4


def test_values_that_scatter_have_no_pattern():
    """Of 40 draws without any order, a pattern is likelier than scatter in at most three (5 % of 40, and one sigma)."""
    wrong = 0
    for seed in range(40):
        change = 0.05 * np.random.default_rng(seed).standard_normal(N)
        found = values(change, 0.005)
        tau = scatter(found)
        top = max(weigh(p, found).log_evidence for p in patterns(found, recordings()))
        wrong += tau is None or top > tau.log_evidence
    assert wrong <= 3


def test_what_scatters_about_another_value_says_so():
    """In standard uncertainties of the common value: 0.05 of a mean of 20 with sqrt(0.02^2 + 0.01^2) each is 10; its
    own scatter makes it 1. Where the value is one of the shared parameters it has no shift."""
    rng = np.random.default_rng(4)
    change = 0.02 * rng.standard_normal(N) + 0.01 * rng.standard_normal(N)
    change -= change.mean()
    for shift in (0.0, 0.05):
        found = scatter(values(change + shift))
        assert found.shift == pytest.approx(shift / (np.hypot(found.value, 0.01) / np.sqrt(N)), abs=1e-6)
    assert scatter(replace(values(change + 0.05), names=("k",), shared=np.array([100.0]))).shift == 0.0


def test_an_instrument_at_fault_shows_the_motion_at_other_times():
    """A polynomial of the third degree, which the spline of the instrument's clock meets exactly."""
    t = np.linspace(0.0, 1.0, 101)
    o = Observation("r", t, t, "r", "r")
    y = t**3 - t
    off = shown(o, y, {OFFSET: 0.003, RATE: 0.02, SCALE: 0.05}, 0.0)
    at = t + 0.003 + 0.02 * t
    assert np.allclose(off, 1.05 * (at**3 - at), atol=1e-9)
    late = shown(o, y, {LOST: 2.0}, 0.5)
    at = t + 0.02 * (t >= 0.5)
    assert np.allclose(late, at**3 - at, atol=1e-9)


def said(d):
    """What is established: (number, kind), and the recordings that stand apart."""
    sure = [v for v in d.varies if v.established]
    return {(v.parameter, str(v.kind)) for v in sure}, {r for v in sure for r in v.recordings}


@pytest.mark.long
def test_a_laboratory_at_fault_is_named():
    """A scale that is another from a day on, by a writing that shares no solver with the analysis."""
    t = truth(3, SEED)
    t = replace(t, factor=6.0 if t.factor else 0.0)
    d = diagnose_jumps(made(t, SEED).task)
    assert said(d) == ({("scale", "step")}, t.apart) and d.named == () and d.discovered is None, d.sentence
    for v in d.varies:  # what is drawn: recordings by themselves lie about what is said of them
        for name, (value, sigma) in v.each.items():
            assert abs(value - (v.value if name in v.recordings else v.declared)) < 6.0 * sigma


def test_what_repeats_tell_scatters_is_said_where_the_model_is_adequate():
    """A start that differs from trial to trial by 0.4 ms, which the noise of the repeats holds already."""
    t = truth(158, 6501)
    d = diagnose_jumps(made(t, 6501).task)
    assert d.adequate and d.named == () and said(d)[0] == {(OFFSET, "scatter")}, d.sentence
    assert d.varies[0].low < MS10 * t.scatter < d.varies[0].high


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "seed", "what"),
    [
        pytest.param(129, SEED, ("amplitude", "odd"), id="entered wrong"),
        pytest.param(122, 6001, ("bed", "drift"), id="a bed that drifts beside a force that passes the test alone"),
        pytest.param(163, 6303, ("bed", "scatter"), id="a bed that scatters among repeats, more than is linear"),
    ],
)
def test_a_force_is_named_beside_a_laboratory_at_fault(number, seed, what):
    t = truth(number, seed)
    d = diagnose_jumps(made(t, seed).task)
    assert d.named == ((t.force,) if t.force else ()) and d.discovered is None, d.sentence
    assert said(d) == ({what}, t.apart if t.pattern == "odd" else set()), d.sentence


def test_what_recordings_could_tell_is_said_before_they_are_made(capsys):
    """Of the samples on sand, from what is declared: numbers that drift beside mechanisms, with their rivals."""
    assert main(["check", str(SAMPLES / "loose_sand"), "--isolable", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    rows = {row["cause"]: row for row in said["isolable"]}
    assert said["jumps"] >= 4 and {"viscous_friction", "drift of spring_stiffness", "drift of scale"} <= set(rows)
    twins = rows["drift of clock_offset"]["not distinguishable from"]  # late by more and more: slow
    assert "drift of clock_rate" in twins
    assert not any("nan" in text for row in said["isolable"] for text in row.values())


@pytest.mark.long
def test_the_scatter_that_repeats_tell_is_that_of_one_trial():
    """Of the start, twelve pairs of trials in each of five campaigns: 60 differences, 9 %; a difference of two trials
    scatters by sqrt(2) of it."""
    found = []
    for seed in range(6401, 6406):
        t = truth(150, seed)
        task = made(t, seed).task
        learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
        found.append(learned.scatter["start"] / (t.scatter * MS10 * np.std(t.changes["start"])))
    assert abs(np.sqrt(np.mean(np.square(found))) - 1.0) < 3 * 0.09


T = np.linspace(0.0, 1.0, 201)
NOISE, TURNS = 1e-3, 100.0
TRUE = np.array([0.0, 0.0102, -0.0098, 0.0049, 0.0155, -0.0051, 0.0201, -0.0197])  # the fifth is in no first value


class Oscillations:
    """y = sin(2 pi f (1 + change) t), beside a drift of unknown slope that all share."""

    def __init__(self, change):
        self.candidates = {}
        self.baseline = (Parameter("slope", 0.0, -1.0, 1.0, 0.1),)
        self.variables = {"f": Variable("f", TURNS, "Hz", 0.01, 1e-6)}
        rng = np.random.default_rng(5)
        y = self.predict_apart((), {"slope": 0.2}, {"f": change}, range(change.size))
        self.observations = [
            Observation(f"run {k}", T, a + NOISE * rng.standard_normal(T.size), f"run {k}", f"run {k}")
            for k, a in enumerate(y)
        ]

    def predict(self, mechanisms, values, which):
        return self.predict_apart(mechanisms, values, {}, which)

    def predict_apart(self, mechanisms, values, changes, which):
        own = changes.get("f", np.zeros(max(which, default=0) + 1))
        return [np.sin(2 * np.pi * TURNS * (1.0 + own[i]) * T) + values["slope"] * T for i in which]

    def scatter(self, mechanisms, values, which):
        return {}

    def varying(self, weighed, log_price=0.0):
        return copy.copy(self)

    def scattered(self, name, changes):
        return copy.copy(self)

    def at_common(self):
        return copy.copy(self)


def test_a_recording_in_another_minimum_is_found():
    """From the grid of first values it falls into a side lobe (0.5 of the motion stays); all values are then those of
    least squares: 8 x 200 readings of noise, and every change within five of its standard uncertainties."""
    problem = Problem(Oscillations(TRUE), Noise(NOISE, 0.0, T[1]))
    fit = problem.fit()
    found = apart(problem, fit, problem.system.variables["f"])
    assert abs(found.chi2 - problem.n) < 5 * np.sqrt(2 * problem.n)
    np.testing.assert_array_less(np.abs(found.change - TRUE), 5 * found.sigma)
