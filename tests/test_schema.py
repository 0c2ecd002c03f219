"""Declared values: what is accepted, and that every problem is named with value, range and remedy."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass

import pytest

from jumpvision.base.schema import InputError, param, read, table_of
from jumpvision.experiment.inputs.parameters import PARAMS
from jumpvision.experiment.inputs.sections import SECTIONS, Header, RodVideo
from jumpvision.jumper.mechanisms.registry import ModelParameters


@dataclass(frozen=True)
class Inner:
    depth: float = param(0.0, "m", "how deep", lo=0)


@dataclass(frozen=True)
class Sample:
    length: float = param(1.0, "m", "how long", lo=0, hi=2, open_lo=True)
    count: int = param(3, "", "how many", lo=1)
    colour: str = param("red", "", "which", choices=("red", "blue"))
    on: bool = param(False, "", "whether")
    points: tuple[tuple[float, ...], ...] = param((), "", "where")
    inner: Inner = param(Inner(), "", "inside")


def test_good_values_are_taken_as_their_types():
    got, problems = read(Sample, {"length": 2, "points": [[1, 2], [3, 4]], "inner": {"depth": 1}}, "f: [s]")
    assert problems == []
    assert got == Sample(length=2.0, points=((1.0, 2.0), (3.0, 4.0)), inner=Inner(1.0))
    assert isinstance(got.length, float)


@pytest.mark.parametrize(
    ("table", "parts"),
    [
        ({"length": 0}, ("length = 0", "(0, 2] m", "how long")),
        ({"length": math.nan}, ("length = nan", "(0, 2] m")),
        ({"length": True}, ("length = True", "number")),
        ({"length": "1"}, ("length = '1'", "number")),
        ({"count": 1.5}, ("count = 1.5", "whole number")),
        ({"count": 0}, ("count = 0", ">= 1")),
        ({"colour": "green"}, ("colour = 'green'", "'red', 'blue'")),
        ({"on": 1}, ("on = 1", "true or false")),
        ({"points": [[1, "a"]]}, ("points", "number")),
        ({"lenght": 1}, ("lenght", "did you mean 'length'")),
        ({"inner": {"depth": -1}}, ("[s.inner]", "depth = -1", ">= 0 m")),
    ],
)
def test_bad_values_are_named(table, parts):
    got, problems = read(Sample, table, "f.toml: [s]")
    assert got is None
    assert len(problems) == 1
    for part in ("f.toml", *parts):
        assert part in problems[0]


def test_all_problems_at_once():
    _, problems = read(Sample, {"length": -1, "count": "a", "colour": 3, "nope": 0}, "f: [s]")
    assert len(problems) == 4


def test_the_error_survives_a_process_boundary():
    error = pickle.loads(pickle.dumps(InputError(["a", "b"])))
    assert error.problems == ["a", "b"]


def test_excluded_frames_are_inclusive_and_carry_their_reason():
    film = RodVideo(file="a.avi", exclude_frames=("3:5 lamp flicker", "9"))
    assert film.excluded(20) == {
        **dict.fromkeys((3, 4, 5), "excluded: lamp flicker"),
        9: "excluded: by the user",
    }
    assert film.check() == []
    assert len(RodVideo(file="a.avi", exclude_frames=("3-5 lamp",)).check()) == 1


@pytest.mark.parametrize(
    "cls", [*SECTIONS.values(), *PARAMS.values(), ModelParameters, Header], ids=lambda c: c.__name__
)
def test_every_declared_value_is_documented_and_its_default_is_allowed(cls):
    rows = table_of(cls)
    assert all(r["meaning"] for r in rows)
    required = {r["name"]: "x" for r in rows if r["default"] == "required"}
    made, problems = read(cls, required, "defaults")
    assert problems == []
    given = {r["name"]: getattr(made, r["name"]) for r in rows}
    simple = {k: v for k, v in given.items() if v is not None and not hasattr(v, "__dataclass_fields__")}
    assert read(cls, simple, "defaults")[1] == []
