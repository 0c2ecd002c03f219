"""The picture of what varies: what it shows, of each kind, in the picture of a diagnosis and on the pages."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_sample import diagnosis
from test_varies_words import DAY, DRIFT, FAST, FREQUENCIES, NAMES, ODD, SCATTER, SOFT

from jumpvision.engine.document.values import Suggested
from jumpvision.report.figures.varies import shown, what_varies
from jumpvision.report.style import styled


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


def test_those_that_stand_apart_are_marked_and_a_few_are_named():
    odd, day = drawn(*EVERY[:2])
    assert [t.get_text() for t in odd.texts] == ["jump-15"]
    assert odd.containers[1].lines[0].get_ydata() == pytest.approx([EVERY[0].each["jump-15"][0]])
    assert len(day.containers[1].lines[0].get_ydata()) == 12 and not day.texts
    assert [t.get_text() for t in day.get_xticklabels()] == ["day 1", "day 2"]


def test_the_pattern_is_drawn_as_it_was_fitted():
    drift, function, scatter = drawn(*EVERY[2:])
    x, y = lines(drift)["drift"].get_data()
    assert (x[0], y[0], x[-1], y[-1]) == (1.0, 3300.0, 24.0, 3036.0)
    x, y = lines(function)["function"].get_data()
    assert list(x) == [5.0, 8.0, 12.0] and list(y) == [1.0, 1.0, 0.84]
    assert function.get_xlabel() == "frequency [Hz]" and scatter.get_xlabel() == "recordings, as they are listed"
    (band,) = scatter.patches
    assert band.get_height() == pytest.approx(2.0 * 4.08)


def test_a_function_below_a_value_and_a_step_in_order():
    slow = tuple(n for n in NAMES if n not in FAST)
    low, step = drawn(
        replace(EVERY[3], recordings=slow), replace(EVERY[1], of="order", at=dict(zip(NAMES, map(float, range(24)))))
    )
    x, y = lines(low)["function"].get_data()
    assert list(x) == [12.0, 9.0, 5.0] and list(y) == [1.0, 1.0, 0.84]
    assert set(lines(step)["step"].get_ydata()) == {1.0, 1.04}


def test_hours_of_times_and_values_without_a_sigma():
    v = replace(EVERY[2], of="time", at={n: 1.8e9 + 3600.0 * k for k, n in enumerate(NAMES)})
    (ax,) = drawn(replace(v, each={n: (y, math.nan) for n, (y, _) in v.each.items()}))
    assert ax.get_xlabel() == "time since the first recording [h]" and ax.lines[0].get_xdata().max() == 23.0


def test_only_what_is_established_and_has_values_is_drawn():
    d = diagnosis(varies=(replace(EVERY[0], established=False), ODD, *EVERY))
    assert shown(d) == list(EVERY[:3])


def test_the_page_of_a_study_has_it(tmp_path):
    from jumpvision.report.pages.study import page

    text = page(diagnosis(varies=EVERY[:1]), b"", "a study")
    assert "What varies" in text and "jump-15" in text
    assert "What varies" not in page(diagnosis(), b"", "a study")


def test_a_line_that_would_mend_it_reads_as_toml():
    assert Suggested("a/experiment.toml", "", "exclude", 'said "no"', "w").line == 'exclude = "said \\"no\\""'
    assert Suggested("a/experiment.toml", "rod_video", "scale", 2.08e-4, "w").line == "[rod_video] scale = 0.000208"
