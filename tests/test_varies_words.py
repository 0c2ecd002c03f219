"""What was taken for constant, as it is said; formulas and probabilities that are not worth saying."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_sample import diagnosis

from jumpvision.base.arrays import Z90
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.sentence import sentence as in_words
from jumpvision.engine.document.values import Closest, LeftOver, Parameter, Pattern, Varies
from jumpvision.engine.document.varies import varies_in_words
from jumpvision.engine.document.words import Words
from jumpvision.jumper.question.words import sentence, words_of

NAMES = tuple(f"jump-{k}" for k in range(1, 25))
WORDS = words_of(diagnosis())


def varies(parameter, kind, value, declared=1.0, sigma=0.001, **more) -> Varies:
    """Of 24 jumps, in their order."""
    given = {"of": None, "recordings": (), "unit": "1", "p_value": 1e-9, "established": True} | more
    given.setdefault("at", dict(zip(NAMES, map(float, range(1, 25)))))
    low, high = value - Z90 * sigma, value + Z90 * sigma
    return Varies(parameter, Pattern(kind), value=value, declared=declared, low=low, high=high, **given)


FREQUENCIES = dict(zip(NAMES, [5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0] * 3))
FAST = tuple(n for n, f in FREQUENCIES.items() if f > 8.0)
DAYS = dict(zip(NAMES, ["day 1"] * 12 + ["day 2"] * 12))
DRIFT = varies("spring_stiffness", "drift", 3036.0, 3300.0, 20.0, of="order", unit="N/m",
               source="`recorded` in experiment.toml")  # fmt: skip
ODD = varies("amplitude", "odd", 1.15, recordings=("jump-15",))
FASTER = varies("frequency", "odd", 1.10, recordings=("jump-15",))
DAY = varies("scale", "step", 1.04, of="session", recordings=NAMES[12:], at=DAYS)
SOFT = varies("amplitude", "function", 0.84, sigma=0.01, of="frequency", recordings=FAST, at=FREQUENCIES)
LOST = varies("lost_frames", "odd", 1.0, 0.0, 0.01, unit="frames", recordings=NAMES[:16:2])
SCATTER = replace(varies("alpha", "scatter", 4.08, 80.0, unit="N s^2/m^2"), low=3.2, high=5.6)


@pytest.mark.parametrize(
    ("v", "text"),
    [
        (ODD, "jump-15 was not driven as its experiment.toml says: 1.15 times the amplitude fits it"),
        (
            replace(ODD, recordings=NAMES[:2]),
            "jump-1 and jump-2 were not driven as their experiment.toml says: 1.15 times the amplitude fits them",
        ),
        (
            varies("spring_stiffness", "odd", 2970.0, 3300.0, 9.0, unit="N/m", recordings=("jump-3",)),
            "the stiffness of the spring is 10.0 % smaller in jump-3",
        ),
        (
            varies("clock_offset", "odd", 0.02, 0.0, unit="s", recordings=NAMES[:3]),
            "the offset of the film's clock is 0.02 s, not 0 s, in jump-1, jump-2 and jump-3",
        ),
        (LOST, "the films of 8 recordings skip one frame: jump-1, jump-3, jump-5 and 5 more"),
        (
            replace(LOST, value=-2.0, recordings=("jump-1",)),
            "the film of jump-1 repeats 2 frames",
        ),
        (DAY, "the scale of the camera is 4.0 % larger in the 12 recordings of session day 2"),
        (
            varies("bed", "step", 1.15, of="order", recordings=NAMES[12:]),
            "the stiffness of the bed is 15.0 % larger in the 12 recordings from jump-13 on",
        ),
        (
            varies("gravity", "step", 9.71, 9.81, 0.01, of="operator", recordings=("jump-1",), at={"jump-1": "B"}),
            "gravity along the rail is 1.0 % smaller in the recording with operator B",
        ),
        (
            varies("bed", "step", 0.9, sigma=0.02, of="temperature_C", recordings=NAMES[20:]),
            "the stiffness of the bed is 10 % smaller in the 4 recordings with temperature_C above 20",
        ),
        (
            DRIFT,
            "the stiffness of the spring falls by 8.0 % from the first to the last recording "
            "(order from `recorded` in experiment.toml)",
        ),
        (SOFT, "the amplitude of the drive falls with frequency above 8 Hz, by 4.0 % a Hz"),
        (
            varies("bed", "function", 1.2, sigma=0.01, of="volume_fraction", at={"a": 0.57, "b": 0.59, "c": 0.62}),
            "the stiffness of the bed rises with the volume fraction, by 20 % from 0.57 to 0.62",
        ),
        (SCATTER, "alpha scatters by 5.1 % (4.0 to 7.0) from jump to jump"),
        (
            replace(SCATTER, declared=0.0, value=0.02, low=0.01, high=0.03, unit="s", parameter="clock_offset"),
            "the offset of the film's clock scatters by 0.020 s (0.010 to 0.030) from jump to jump",
        ),
    ],
)  # fmt: skip
def test_a_number_that_varies_in_words(v, text):
    assert varies_in_words(v, WORDS) == text


@pytest.mark.parametrize("v", [ODD, DAY, DRIFT, SOFT, LOST, SCATTER, replace(DRIFT, declared=0.0)])
def test_what_is_not_known_is_never_said_as_such(v):
    bare = replace(v, low=math.nan, high=math.inf, at={}, source="", each={})
    for said in (varies_in_words(bare, WORDS), varies_in_words(bare, Words("It misses", str))):
        assert not any(word in said.lower() for word in ("nan", "inf", "none")), said


def test_how_a_jump_was_driven_is_told_of_all_its_numbers_together():
    d = diagnosis(varies=(ODD, DAY, FASTER), status="complete")
    assert sentence(d) == (
        "jump-15 was not driven as its experiment.toml says: 1.15 times the amplitude at 1.1 times the frequency fits "
        "it; the scale of the camera is 4.0 % larger in the 12 recordings of session day 2; with that the model is "
        "adequate."
    )


@pytest.mark.parametrize(
    ("v", "end"),
    [
        (ODD, "fits it; without it the model is adequate."),
        (LOST, "and 5 more; without them the model is adequate."),
        (DRIFT, "; with that the model is adequate."),
    ],
)
def test_a_model_that_is_adequate_but_for_it(v, end):
    said = sentence(diagnosis(varies=(v,), status="complete"))
    assert said.endswith(end)
    assert said.startswith(("jump-15", "The films", "The stiffness"))


def test_a_model_that_agrees_where_a_number_scatters():
    said = sentence(diagnosis(varies=(SCATTER,), verdict="adequate", p_value=0.31, status="complete"))
    assert said == (
        "alpha scatters by 5.1 % (4.0 to 7.0) from jump to jump; with that the simulation agrees with the measured "
        "jumps within their noise (p = 0.31)."
    )


def test_beside_it_a_mechanism_or_more_that_is_left():
    left = LeftOver(3.0, 0.02, 1.0, ("jump-3", "jump-9", "jump-2"))
    d = diagnosis(varies=(DAY,), named=("coulomb_friction",), status="complete")
    first, then = sentence(d).split(". In addition it lacks ")
    assert first.startswith("The scale of the camera is 4.0 %") and then == "dry friction on the rail."
    partial = sentence(diagnosis(varies=(DAY,), status="partial", left_over=left))
    assert partial.endswith(
        "; 2 % of the discrepancy (in chi^2) remains beyond the noise; what is left has no simple form: look at "
        "jump-3, jump-9 and jump-2."
    )


def test_what_is_not_established_is_not_said():
    d = diagnosis(varies=(replace(ODD, established=False),), left_over=LeftOver(9.0, 1.0, 1.0, NAMES[:3]))
    said = sentence(d)
    assert "jump-15" not in said
    assert said.endswith("; what is left has no simple form: look at jump-1, jump-2 and jump-3.")


def test_nothing_likelier_than_chance_has_nowhere_to_look():
    assert "no cause is more likely than chance" in sentence(diagnosis(left_over=LeftOver(1.2, 1.0, 1.0)))


def test_a_study_says_it_in_its_own_words():
    words = Words("It misses", str, quantities={"W": "the stiffness of the string"})
    v = varies("W", "drift", 45.0, 50.0, 1.0, of="time", source="`recorded` of the recordings")
    said = in_words(diagnosis(varies=(v,), status="complete"), words)
    assert said == (
        "The stiffness of the string falls by 10 % from the first to the last recording (time from `recorded` of the "
        "recordings); with that the model is adequate."
    )


def test_the_file_gives_back_what_was_written():
    d = diagnosis(
        varies=(replace(DAY, each={"jump-1": (1.0, 0.01)}), SCATTER), left_over=LeftOver(1.0, 1.0, 1.0, NAMES)
    )
    back = Diagnosis.from_values(d.values)
    assert back.varies == d.varies and back.left_over == d.left_over
    assert np.all([v.established for v in back.varies])


def test_a_small_probability_is_no_zero():
    assert "< 0.001" in repr(
        diagnosis(causes=(replace(_cause(), probability=1e-5),), closest=Closest(("tilt",), 1e-5, {}, 1e-3, None))
    )


def _cause():
    from diagnosis_sample import causes

    return causes(("tilt",), {})[0]


@pytest.mark.parametrize(
    ("value", "half", "text"),
    [(60.0, 1.2e-3, "60 (59.9988 to 60.0012) m"), (60.0, 5.0, "60 (55 to 65) m"), (0.0, 0.1, "0 (-0.1 to 0.1) m")],
)
def test_an_interval_has_the_digits_that_tell_its_ends_apart(value, half, text):
    assert str(Parameter(value, value - half, value + half, "m")) == text
