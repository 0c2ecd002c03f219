"""No sentence holds nan, inf, None or 0x: a number that is not known is left out, or called unknown.

Truth: a whole diagnosis in which each number in turn, by every path to it, is NaN, infinite, zero or None.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from diagnosis_sample import causes, confirmation, diagnosis, parameter

from jumpvision.base.arrays import measured
from jumpvision.base.numbers import between, said
from jumpvision.cli import terminal
from jumpvision.engine.document import values as record
from jumpvision.engine.document.sentence import Words
from jumpvision.engine.document.sentence import sentence as of_any_system
from jumpvision.experiment.results.summary import JumpRow, Summary, Uncertain
from jumpvision.jumper.question.words import confirmed, sentence
from jumpvision.report.figures.diagnosis import gain_words
from jumpvision.report.pages.study import facts
from jumpvision.report.pages.verdict import causes_shown, detectable_shown
from jumpvision.report.pages.words import campaign_words, noise_words

BAD = re.compile(r"(?<![A-Za-z_])[-+]?(nan|NaN|inf|Infinity|None)x?(?![A-Za-z_])|(?<![\d.])0(\.0+)?[x×]")
GAIN = record.Gain(("a", "b"), 0.004, 0.001, 0.003, 0.0006, 5.0, (3.0, 8.0), True)
TERMS = record.Model(("inertial_drag",), {"alpha": 80.0})


def whole(**parts: Any):
    """All that a diagnosis may say."""
    found = {"C": parameter(2.7, 0.2), "k": parameter(1.0, 0.1, "N/m")}
    heights = tuple(record.Height(f"{k}-{i}", k, 7.0, 0.0, 0.57, 0.03, 2e-5, 0.04, 0.031)
                    for k in ("single", "stutter") for i in range(3))  # fmt: skip
    given = {
        "heights": heights,
        "causes": causes(("added_mass",), found),
        "named": ("added_mass",),
        "status": "partial",
        "left_over": record.LeftOver(1.4, 0.1, 1.2),
        "indistinguishable": (("payload", "spring_stiffness"),),
        "detectable": (record.Detectable("payload", "dm", 0.01, "kg"),),
        "gain": GAIN,
        "confirmation": (confirmation("added mass", (0.15, 0.003), (0.14, 0.002), depth_m=0.02),
                         confirmation("mu", (2.0, 0.1), (3.0, 0.1), verdict="contradict")),
        "next_experiment": record.NextExperiment("stutter", 9.0, 0.05, ("a", "b"), 3.1),
        "discovered": None,
    }  # fmt: skip
    return diagnosis(**{**given, **parts})


CLOSEST = record.Closest(("added_mass", "payload"), 0.3, {"C": parameter(2.7, 0.2)}, 0.002, GAIN)
LAW = record.Discovered("q*v", "foot", {"q": record.Estimated(3.0, 0.1, "N s/m")}, {}, 0.8, True, 0.9, (), {}, ())
CASES = [
    whole(),
    whole(named=(), causes=(), status="undetermined", closest=CLOSEST),
    whole(named=(), status="undetermined", discovered=LAW),
    whole(verdict="adequate", named=(), p_value=0.4),
]


def broken(value: Any, bad: Any) -> Iterator[Any]:
    """The value with one of its numbers `bad`, for every number in it."""
    if isinstance(value, float):
        yield bad
    elif dataclasses.is_dataclass(value):
        for f in dataclasses.fields(value):
            for other in broken(getattr(value, f.name), bad):
                yield dataclasses.replace(value, **{f.name: other})
    elif isinstance(value, tuple):
        for i, x in enumerate(value):
            for other in broken(x, bad):
                yield (*value[:i], other, *value[i + 1 :])
    elif isinstance(value, Mapping):
        for k, x in value.items():
            for other in broken(x, bad):
                yield {**value, k: other}


WORDS = Words("The simulation misses", lambda x: said(x, ".2g"))


def sentences(d, capsys) -> list[str]:
    """All that is said of a diagnosis, by the document, the page and the terminal."""
    d = dataclasses.replace(d, sentence=sentence(d), confirmed=confirmed(d))
    terminal.diagnosis(d, None, [], as_json=False)
    printed = capsys.readouterr()
    rows = [*causes_shown(d), *detectable_shown(d)]
    text, shown = campaign_words([], d, None, 0)
    pages = [text, noise_words(d.noise), *(x for row in (*shown, *facts(d)) for x in row)]
    pages += [gain_words(d.gain)] if d.gain else []
    return [d.sentence, d.confirmed or "", of_any_system(d, WORDS), d.could_hide, repr(d), d.explain("added_mass"),
            printed.out, printed.err, *pages, *(x for r in rows for x in r.values())]  # fmt: skip


@pytest.mark.parametrize("bad", [math.nan, -math.inf, 0.0])
@pytest.mark.parametrize("case", range(len(CASES)))
def test_no_number_that_is_not_known_stands_in_a_sentence(case, bad, capsys, monkeypatch):
    monkeypatch.setattr(terminal, "beside_truth", lambda d, campaign: None)
    count = 0
    for d in broken(CASES[case], bad):
        count += 1
        for text in sentences(d, capsys):
            found = BAD.search(text)
            assert not found, f"{found[0]} in: {text[:400]}"
    assert count >= 80


def test_a_campaign_without_a_diagnosis_says_none_either():
    for h, sigma, model in itertools.product((0.03, math.nan), (1e-5, None, math.nan), (0.04, None, math.nan)):
        row = JumpRow("a", summary=Summary("a", jump_height=Uncertain(h, sigma, 0.0), simulated_height=model))
        text, shown = campaign_words([row], None, None, 0)
        assert not any(BAD.search(t) for t in (text, *(x for r in shown for x in r)))


def test_what_is_known_is_said():
    assert said(0.01234, ".3g", 1e3) == "12.3" and said(None) == said(math.inf) == said(math.nan) == "unknown"
    assert between(1.0, 2.0) == " (1 to 2)" and between(1.0, math.inf) == " (above 1)"
    assert between(math.nan, 2.0) == " (below 2)" and between(None, math.nan) == ""
    assert measured(math.nan, 1.0) == measured(None, 1.0) == "" and measured(1.25, math.nan) == "1.250"


def test_the_search_finds_what_it_should():
    assert all(BAD.search(t) for t in ("falls nanx", "by inf mm", "falls 0x", "is None", "(nan to nan)", "0.0×"))
    assert not any(BAD.search(t) for t in ("information", "10x", "finance", "0.5x", "infinite", "none"))
