"""What varied between recordings: its words, its record, its picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_sample import diagnosis

from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.values import LeftOver, Parameter, Suggested
from jumpvision.engine.document.varies import varies_in_words
from jumpvision.engine.document.words import Words
from jumpvision.jumper.question.words import sentence, words_of
from jumpvision.report.figures.varies import shown, what_varies
from jumpvision.report.style import styled
from tests.worlds.varies import DAY, DRIFT, FASTER, FREQUENCIES, LOST, NAMES, ODD, SCATTER, SOFT, varies

WORDS = words_of(diagnosis())


BED = varies("bed", "function", 1.2, sigma=0.01, of="volume_fraction", at={"a": 0.57, "b": 0.59, "c": 0.62})


@pytest.mark.parametrize(
    ("v", "said"),
    [
        (ODD, ("jump-15 was not driven as its experiment.toml says", "1.15 times the amplitude")),
        (LOST, ("the films of 8 recordings skip one frame", "and 5 more")),
        (DAY, ("the scale of the camera is 4.0 % larger", "the 12 recordings of session day 2")),
        (DRIFT, ("the stiffness of the spring falls by 8.0 %", "(order from `recorded` in experiment.toml)")),
        (SOFT, ("the amplitude of the drive falls with frequency above 8 Hz, by 4.0 % a Hz",)),
        (BED, ("the stiffness of the bed rises", "by 20 % from 0.57 to 0.62")),
        (SCATTER, ("alpha scatters by 5.1 % (4.0 to 7.0)",)),
    ],
)
def test_a_number_that_varies_is_told_with_its_size_and_its_recordings(v, said):
    text = varies_in_words(v, WORDS)
    assert all(part in text for part in said), text


@pytest.mark.parametrize("v", [ODD, DAY, DRIFT, SOFT, LOST, SCATTER, replace(DRIFT, declared=0.0)])
def test_what_is_not_known_is_never_said_as_such(v):
    bare = replace(v, low=math.nan, high=math.inf, at={}, source="", each={})
    for said in (varies_in_words(bare, WORDS), varies_in_words(bare, Words("It misses", str))):
        assert not any(word in said.lower() for word in ("nan", "inf", "none")), said


def test_what_is_established_is_said_beside_the_mechanism_and_nothing_else():
    told = sentence(diagnosis(varies=(ODD, DAY, FASTER), named=("coulomb_friction",), status="complete"))
    assert "1.15 times the amplitude at 1.1 times the frequency" in told and "session day 2" in told
    assert "dry friction on the rail" in told
    doubtful = diagnosis(varies=(replace(ODD, established=False),), left_over=LeftOver(9.0, 1.0, 1.0, NAMES[:3]))
    assert "jump-15" not in sentence(doubtful) and "jump-1, jump-2 and jump-3" in sentence(doubtful)


def test_the_file_gives_back_what_was_written():
    d = diagnosis(
        varies=(replace(DAY, each={"jump-1": (1.0, 0.01)}), SCATTER), left_over=LeftOver(1.0, 1.0, 1.0, NAMES)
    )
    back = Diagnosis.from_values(d.values)
    assert back.varies == d.varies and back.left_over == d.left_over
    assert np.all([v.established for v in back.varies])


@pytest.mark.parametrize(
    ("value", "half", "text"),
    [(60.0, 1.2e-3, "60 (59.9988 to 60.0012) m"), (60.0, 5.0, "60 (55 to 65) m"), (0.0, 0.1, "0 (-0.1 to 0.1) m")],
)
def test_an_interval_has_the_digits_that_tell_its_ends_apart(value, half, text):
    assert str(Parameter(value, value - half, value + half, "m")) == text


def with_values(v, truth, sigma):
    """The same with own values of all 24 recordings."""
    rng = np.random.default_rng(3)
    each = {n: (truth(n) + rng.normal(0.0, sigma), sigma) for n in NAMES}
    return replace(v, each=each, at=v.at)


EVERY = (
    with_values(ODD, lambda n: 1.15 if n == "jump-15" else 1.0, 0.004),
    with_values(DAY, lambda n: 1.04 if n in DAY.recordings else 1.0, 0.003),
    with_values(DRIFT, lambda n: 3300.0 - 264.0 * (NAMES.index(n) / 23.0), 25.0),
    with_values(SOFT, lambda n: 1.0 - 0.04 * max(FREQUENCIES[n] - 8.0, 0.0), 0.006),
    replace(with_values(SCATTER, lambda n: 80.0 + 4.0 * math.sin(7.0 * NAMES.index(n)), 0.8), at={}),
)


def drawn(*varies):
    with styled() as Figure:
        figure = what_varies(varies, Figure)
        figure.canvas.draw()
    return figure.axes


def lines(ax):
    return {line.get_label(): line for line in ax.lines}


@pytest.mark.parametrize("v", EVERY, ids=lambda v: str(v.kind))
def test_every_value_stands_at_its_place_with_the_declared_one(v):
    (ax,) = drawn(v)
    points = np.concatenate([c.lines[0].get_ydata() for c in ax.containers])
    assert sorted(points) == pytest.approx(sorted(y for y, _ in v.each.values()))
    assert set(lines(ax)["declared"].get_ydata()) == {v.declared}
    low, high = ax.get_ylim()
    assert low < min(points) and max(points) < high


def test_the_pattern_is_drawn_as_it_was_fitted():
    drift, function, scatter = drawn(*EVERY[2:])
    x, y = lines(drift)["drift"].get_data()
    assert (x[0], y[0], x[-1], y[-1]) == (1.0, 3300.0, 24.0, 3036.0)
    x, y = lines(function)["function"].get_data()
    assert list(x) == [5.0, 8.0, 12.0] and list(y) == [1.0, 1.0, 0.84]
    assert function.get_xlabel() == "frequency [Hz]" and scatter.get_xlabel() == "recordings, as they are listed"
    (band,) = scatter.patches
    assert band.get_height() == pytest.approx(2.0 * 4.08)


def test_only_what_is_established_and_has_values_is_drawn():
    d = diagnosis(varies=(replace(EVERY[0], established=False), ODD, *EVERY))
    assert shown(d) == list(EVERY[:3])


def test_a_line_that_would_mend_it_reads_as_toml():
    assert Suggested("a/experiment.toml", "", "exclude", 'said "no"', "w").line == 'exclude = "said \\"no\\""'
    assert Suggested("a/experiment.toml", "rod_video", "scale", 2.08e-4, "w").line == "[rod_video] scale = 0.000208"
