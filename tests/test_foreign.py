"""A stranger's simulator at the door: ridges, idle parameters, steps, interruption, kept runs; scipy beside."""

from __future__ import annotations

import math

import numpy as np
import pytest

import jumpvision as jv
from benchmarks import foreign, least_squares
from jumpvision.engine import How, diagnose

SEED = 72  # the cases were developed on others


@pytest.mark.parametrize("row", ["ratio", "confounded", "ignored", "function", "stepped"])
def test_a_case_is_said_as_it_must_be(row):
    """Numbers that cannot be told, names that are not read, another function's gain, a march in steps."""
    said = foreign.ROWS[row](np.random.default_rng([SEED, 0]))
    assert said.good, said.text


@pytest.mark.parametrize("name", ["saturation", "product", "valley", "dry friction", "stepped fall"])
def test_no_fit_is_worse_than_scipy_s_from_the_same_start(name):
    ours, theirs, _ = least_squares.beside(least_squares.CASES[name], SEED)
    assert not least_squares.worse(ours, theirs), (ours, theirs)


def fallen(p, r):
    """Fall with drag, midpoint rule."""
    y, v, h, out = 0.0, 0.0, 5e-3, []
    for _ in r.t:
        out.append(y)
        for _ in range(4):  # the force of the middle of the step: 0.1 mm off after 1.2 s
            half = v + 0.5 * h * (p["g"] - p["drag"] * v * abs(v) - p["slip"] * v)
            y += h * half
            v += h * (p["g"] - p["drag"] * half * abs(half) - p["slip"] * half)
    return np.array(out)


def falling(function=fallen):
    return jv.Study(
        function,
        [jv.Parameter("g", 9.0, (5, 15), unit="m/s^2")],
        [
            jv.Mechanism("air", [jv.Parameter("drag", 0.0, (0, 3), scale=0.05)], "drag of the air"),
            jv.Mechanism("grease", [jv.Parameter("slip", 0.0, (0, 3), scale=0.05)], "viscous friction"),
        ],
        [jv.Channel("y", "m", noise=1e-3)],
    )


def falls(drag=0.2):
    """By the closed form of a fall with quadratic drag."""
    t, rng, out = np.arange(0.0, 1.2, 0.02), np.random.default_rng(SEED), []
    for k in range(3):
        y = np.log(np.cosh(t * math.sqrt(9.81 * drag))) / drag + 1e-3 * rng.standard_normal(t.size)
        out.append(jv.Recording(f"fall {k}", t, y))
    return out


def test_an_interrupted_diagnosis_tells_what_is_known():
    class Stopped:
        def __init__(self, after):
            self.left = after

        def __call__(self, p, r):
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt
            return fallen(p, r)

    found = jv.diagnose(falls(), falling(Stopped(90)))
    assert found.verdict == "discrepant" and found.named == () and found.status == "undetermined"
    assert "not known yet: it was interrupted" in found.sentence
    with pytest.raises(KeyboardInterrupt):  # before anything was found
        jv.diagnose(falls(), falling(Stopped(3)))


def test_progress_has_a_total_and_the_time_left(monkeypatch):
    from jumpvision.engine.study import runs

    monkeypatch.setattr(runs, "BETWEEN", 0.0)
    said = []
    jv.diagnose(falls(), falling(), progress=said.append)
    told = [text for text in said if text.startswith("simulations") and "left" in text]
    assert told and all(" of about " in text and text.endswith("s left") for text in told)


def test_runs_that_were_kept_unasked_serve_unless_they_come_out_otherwise(tmp_path):
    how = How(keep=tmp_path / "runs.sqlite", doubted=True)  # as of `results=`
    first = diagnose(falls(), falling(), how)
    again = diagnose(falls(), falling(), how)
    assert again.runs.made == 1 and again.runs.kept == first.runs.made  # one is made again, to see
    factor = [1.0]

    def changed(p, r):
        return factor[0] * fallen(p, r)

    one = diagnose(falls(), falling(changed), how)
    factor[0] = 1.1  # which no text of the function shows
    other = diagnose(falls(), falling(changed), how)
    assert other.runs.made > 20 and other.fitted["g"].value < 0.95 * one.fitted["g"].value


def test_every_model_named_has_its_open_loop_error():
    found = jv.diagnose(falls(), falling())
    assert found.named == ("air",)
    before, after = found.simulated
    assert before.mechanisms == () and after.mechanisms == ("air",)
    off = found.samples.measured - found.samples.extended
    assert after.rms["y"] == pytest.approx(float(np.sqrt(np.mean(off**2))), rel=1e-6)
    assert after.rms["y"] < 1.3e-3 < before.rms["y"]


def test_a_parameter_that_matters_only_beside_another_is_not_idle():
    """A phase does nothing at an amplitude of 0, where the probe begins."""
    t, rng = np.arange(0.0, 2.0, 0.02), np.random.default_rng(SEED)
    y = 0.5 * t + 0.3 * np.sin(5.0 * t + 0.7) + 1e-2 * rng.standard_normal(t.size)
    free = [
        jv.Parameter("slope", 0.4, (0, 2)),
        jv.Parameter("size", 0.0, (-1, 1)),
        jv.Parameter("phase", 0.2, (-3, 3), unit="rad"),
    ]
    study = jv.Study(
        lambda p, r: p["slope"] * r.t + p["size"] * np.sin(5.0 * r.t + p["phase"]),
        free,
        [],
        [jv.Channel(noise=1e-2)],
    )
    found = jv.diagnose([jv.Recording("one", t, y)], study)
    assert found.adequate and not found.doubts
    assert abs(found.fitted["phase"].value - 0.7) < 4 * found.fitted["phase"].sigma < 0.05


def test_a_curved_ridge_is_followed_to_its_ends():
    """Of a product 3, each factor within .1 to 5: from .6 to 5."""
    t, rng = np.arange(0.0, 2.0, 0.02), np.random.default_rng(SEED)
    y = 3.0 * t + 0.02 * rng.standard_normal(t.size)
    study = jv.Study(
        lambda p, r: p["a"] * p["b"] * r.t,
        [jv.Parameter(n, 1.0, (0.1, 5)) for n in "ab"],
        [],
        [jv.Channel(noise=0.02)],
    )
    found = jv.diagnose([jv.Recording("one", t, y)], study)
    (doubt,) = found.doubts
    assert (
        doubt.kind == "cannot tell"
        and set(doubt.names) == {"a", "b"}
        and "cannot determine them separately" in found.sentence
    )
    for name in "ab":
        assert found.fitted[name].low < 0.65 and found.fitted[name].high > 4.8


MARCH = 2.3e-3  # s, of a simulator's steps, between which it stands


def test_a_march_that_shows_at_shifted_times_alone_enters_the_noise():
    """A fall read at its last step before each time: smooth in g, late by 0 to MARCH, evenly; a speed of rms v makes of
    it a standard deviation of v MARCH / sqrt(12), to a tenth (80 samples). The same fall without steps has none."""
    t, rng = np.arange(80) / 200, np.random.default_rng(SEED)
    recordings = [jv.Recording(f"fall {k}", t, 0.5 * 9.81 * t**2 + 1e-3 * rng.standard_normal(80)) for k in range(3)]

    def marching(p, r):
        return 0.5 * p["g"] * (np.floor(r.t / MARCH) * MARCH) ** 2

    def asked(function):
        channels = [jv.Channel("y", "m", noise=1e-3, delay_sigma=0.01)]
        return jv.diagnose(recordings, jv.Study(function, [jv.Parameter("g", 9.7, (9, 11))], [], channels))

    found = asked(marching)
    (doubt,) = found.doubts
    own = found.noise.sources["the simulator"].sigma_m
    assert doubt.names == ("time",) and "shifted times" in doubt.words and found.baseline.chi2_per_dof < 1.5
    assert own == pytest.approx(9.7 * float(np.sqrt(np.mean(t**2))) * MARCH / math.sqrt(12), rel=0.2)
    plain = asked(lambda p, r: 0.5 * p["g"] * r.t**2)
    assert not plain.doubts and "the simulator" not in plain.noise.sources
