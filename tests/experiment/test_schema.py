"""Declared values: what is accepted, and that every problem is named with value, range and remedy."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass

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


def test_bad_values_are_named_all_at_once():
    bad = [
        ({"length": 0}, ("length = 0", "(0, 2] m", "how long")), ({"length": math.nan}, ("length = nan", "(0, 2] m")),
        ({"length": True}, ("length = True",)), ({"length": "1"}, ("length = '1'",)),
        ({"count": 1.5}, ("count = 1.5",)),
        ({"count": 0}, ("count = 0", ">= 1")), ({"colour": "green"}, ("colour = 'green'", "'red', 'blue'")),
        ({"on": 1}, ("on = 1",)), ({"points": [[1, "a"]]}, ("points",)), ({"lenght": 1}, ("lenght", "'length'")),
        ({"inner": {"depth": -1}}, ("[s.inner]", "depth = -1", ">= 0 m")),
    ]  # fmt: skip
    for table, parts in bad:
        got, problems = read(Sample, table, "f.toml: [s]")
        assert got is None and len(problems) == 1
        assert all(part in problems[0] for part in ("f.toml", *parts)), problems
    _, problems = read(Sample, {"length": -1, "count": "a", "colour": 3, "nope": 0}, "f: [s]")
    assert len(problems) == 4
    assert pickle.loads(pickle.dumps(InputError(problems))).problems == problems  # from another process


def test_excluded_frames_are_inclusive_and_carry_their_reason():
    film = RodVideo(file="a.avi", exclude_frames=("3:5 lamp flicker", "9"))
    assert film.excluded(20) == {**dict.fromkeys((3, 4, 5), "excluded: lamp flicker"), 9: "excluded: by the user"}
    assert film.check() == []
    assert len(RodVideo(file="a.avi", exclude_frames=("3-5 lamp",)).check()) == 1
    endless = RodVideo(file="a.avi", exclude_frames=("5:999999999 lamp", "2"))
    assert endless.excluded(7) == {2: "excluded: by the user", 5: "excluded: lamp", 6: "excluded: lamp"}
    assert len(RodVideo(file="a.avi", exclude_frames=("0:100000000000",)).check()) == 1


def test_every_declared_value_is_documented_and_its_default_is_allowed():
    for cls in (*SECTIONS.values(), *PARAMS.values(), ModelParameters, Header):
        rows = table_of(cls)
        assert all(r["meaning"] for r in rows), cls
        required = {r["name"]: "x" for r in rows if r["default"] == "required"}
        made, problems = read(cls, required, "defaults")
        assert problems == []
        given = {r["name"]: getattr(made, r["name"]) for r in rows}
        simple = {k: v for k, v in given.items() if v is not None and not hasattr(v, "__dataclass_fields__")}
        assert read(cls, simple, "defaults")[1] == []
