"""Declared values: unit, meaning and allowed range beside the default, and one validator for all of them.

A section of a TOML file, the parameters of a stage and the parameters of a force term are frozen dataclasses whose
fields are made by `param`. The same declaration validates files, prints the tables of the documentation and gives
fits their bounds.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
import types
import warnings
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, ClassVar, TypedDict, Union, get_args, get_origin, get_type_hints

REQUIRED = dataclasses.MISSING
Toml = Mapping[str, Any]  # a table as TOML has it: text, numbers, lists and tables by key


class InputError(ValueError):
    """Bad input, with every problem found: each names file, section, key, value and what is allowed."""

    def __init__(self, problems: Iterable[str]):
        self.problems = list(problems)
        super().__init__("\n".join(self.problems))

    def __reduce__(self) -> tuple[object, ...]:  # keeps .problems when the error crosses a process boundary
        return (type(self), (self.problems,))


KINDS: Mapping[str, str] = {
    "unit": "a value that is right in another unit",
    "sign": "upside down, negated, or 0 and 1 exchanged",
    "clock": "recordings that do not overlap in time, or run at different rates",
    "scale": "a motion too fast or too slow for gravity: scale, frame rate or tilt",
    "differs": "two recordings, or a recording and what is declared, disagree",
    "copy": "the same recording twice",
    "place": "marks, feet or floors outside the picture, or off their places",
    "name": "a folder that is named after another jump",
    "walls": "a bed too small for its foot",
    "reading": "values that are no readings: held, clipped, leaping, turned over",
    "frames": "frames, columns or partners that are lost or damaged",
    "light": "saturated light",
    "exposure": "motion during an exposure",
    "noise": "more scatter than was stated",
    "law": "data that do not follow the law fitted to them",
    "range": "a law used beyond what it was measured for",
    "missing": "what is not given, and what is done without it",
    "cache": "an entry of the cache that was damaged",
}


class WarningRecord(TypedDict):
    """A warning as files hold it. kind: of KINDS; recording: the section that is the likely cause, or ""; values: the
    numbers compared, by names that end in their units."""

    kind: str
    message: str
    recording: str
    values: Mapping[str, float]


class StageWarning(UserWarning):
    """Something a user should know about a result that stands all the same: of a stage, which keeps it with the result,
    or of a function of arrays.

    kind, recording, values: as in `WarningRecord`. Raises ValueError for another kind.
    """

    def __init__(self, kind: str, message: str, recording: str = "", values: Mapping[str, float] = {}) -> None:
        if kind not in KINDS:
            raise ValueError(f"a warning of kind {kind!r}{closest(kind, KINDS)}")
        super().__init__(message)
        self.kind, self.recording, self.values = kind, recording, dict(values)

    def __reduce__(self) -> tuple[object, ...]:  # between processes
        return StageWarning, (self.kind, str(self), self.recording, self.values)

    @property
    def record(self) -> WarningRecord:
        """As files hold it, without values that are not finite."""
        values = {k: float(v) for k, v in self.values.items() if math.isfinite(v)}
        return {"kind": self.kind, "message": str(self), "recording": self.recording, "values": values}


def warnings_in(caught: Iterable[warnings.WarningMessage]) -> list[WarningRecord]:
    """The stage warnings among what was caught, each once."""
    found = [w.message.record for w in caught if isinstance(w.message, StageWarning)]
    return [t for i, t in enumerate(found) if t not in found[:i]]


def harmless(text: str) -> str:
    """Without what would steer a terminal: names and cells of other people's files are shown, not obeyed."""
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


def param(
    default: object,
    unit: str,
    meaning: str,
    *,
    lo: float = -math.inf,
    hi: float = math.inf,
    choices: tuple[str, ...] = (),
    open_lo: bool = False,
) -> Any:
    """A dataclass field with its unit ("" = none), meaning and allowed values: lo <= value <= hi (or lo < value).

    default: the value, REQUIRED, or a tuple (taken as it is). For a list the bounds hold for every entry.
    """
    metadata = {"unit": unit, "meaning": meaning, "lo": lo, "hi": hi, "choices": choices, "open_lo": open_lo}
    if default is REQUIRED:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def closest(name: str, names: Iterable[str]) -> str:
    """`; did you mean 'x'?` for the nearest known name, else the list of what is allowed."""
    names = list(names)
    near = difflib.get_close_matches(name, names, n=1)
    if near:
        return f"; did you mean '{near[0]}'?"
    return f"; allowed: {', '.join(sorted(names))}" if len(names) <= 30 else ""


@functools.cache  # resolving annotations takes a millisecond
def _hints(cls: type) -> dict[str, type]:
    return get_type_hints(cls)


@functools.cache
def type_of(cls: type, name: str) -> tuple[type, bool]:
    """The plain type of a field and whether None is allowed."""
    hint = _hints(cls)[name]
    if get_origin(hint) in (Union, types.UnionType):
        rest = [t for t in get_args(hint) if t is not type(None)]
        return rest[0], True
    return hint, False


def allowed(meta: Toml) -> str:
    """What a field may hold, in words: `in [0, 1] m`, `> 0 kg`, `one of 'a', 'b'`."""
    if meta["choices"]:
        return "one of " + ", ".join(f"'{c}'" for c in meta["choices"])
    lo, hi, unit = meta["lo"], meta["hi"], f" {meta['unit']}" if meta["unit"] else ""
    if math.isinf(lo) and math.isinf(hi):
        return f"a finite number{unit and ' in' + unit}"
    if math.isinf(hi):
        return f"{'>' if meta['open_lo'] else '>='} {lo:g}{unit}"
    return f"in {'(' if meta['open_lo'] else '['}{lo:g}, {hi:g}]{unit}"


def check_value(value: object, hint: type, meta: Toml) -> tuple[object, str]:
    """The value as its declared type and "", or the value and what is wrong with it."""
    base = get_origin(hint) or hint
    if base is float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return value, f"must be a number ({meta['meaning']})"
        try:
            value = float(value)
        except OverflowError:  # a whole number beyond 1e308
            value = math.inf
        low = value <= meta["lo"] if meta["open_lo"] else value < meta["lo"]
        if not math.isfinite(value) or low or value > meta["hi"]:
            return value, f"must be {allowed(meta)} ({meta['meaning']})"
    elif base is int:
        if isinstance(value, bool) or not isinstance(value, int):
            return value, f"must be a whole number ({meta['meaning']})"
        if not meta["lo"] <= value <= meta["hi"]:
            return value, f"must be {allowed(meta)} ({meta['meaning']})"
    elif base is bool:
        if not isinstance(value, bool):
            return value, f"must be true or false ({meta['meaning']})"
    elif base is str:
        if not isinstance(value, str):
            return value, f"must be text in quotes ({meta['meaning']})"
        if meta["choices"] and value not in meta["choices"]:
            return value, f"must be {allowed(meta)} ({meta['meaning']})"
    elif base is datetime:
        if not isinstance(value, datetime):
            return value, f"must be a date with a time, not in quotes: 2026-11-25T10:02:00 ({meta['meaning']})"
    elif base is dict:
        if not isinstance(value, Mapping) or not all(isinstance(v, str) for v in value.values()):
            return value, f"must be a table of texts ({meta['meaning']})"
        return dict(value), ""
    elif base is tuple:
        if not isinstance(value, (list, tuple)):
            return value, f"must be a list ({meta['meaning']})"
        item = get_args(hint)[0]
        out = []
        for v in value:
            v, problem = check_value(v, item, meta)
            if problem:
                return value, problem
            out.append(v)
        return tuple(out), ""
    return value, ""


def read(cls: type, table: object, where: str, *, extra: Iterable[str] = ()) -> tuple[Any, list[str]]:
    """(object or None, problems): `table` as a `cls`, with every problem found.

    where: how a message names the table, e.g. `run-3/experiment.toml: [robot]`. extra: keys to leave alone.
    """
    if not isinstance(table, Mapping):
        return None, [f"{where} = {table!r}: must be a table"]
    fields = {f.name: f for f in dataclasses.fields(cls) if f.metadata}
    problems, values = [], {}
    for key, value in table.items():
        if key in extra:
            continue
        if key not in fields:
            problems.append(f"{where} {key} = {_short(value)}: unknown key{closest(key, fields)}")
            continue
        hint, _ = type_of(cls, key)
        if isinstance(hint, type) and dataclasses.is_dataclass(hint):
            values[key], inner = read(hint, value, where.replace("]", f".{key}]"))
            problems += inner
            continue
        values[key], problem = check_value(value, hint, fields[key].metadata)
        if problem:
            problems.append(f"{where} {key} = {_short(value)}: {problem}")
    for name, f in fields.items():
        if name not in table and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
            problems.append(f"{where} {name}: missing; give {name} = ... ({describe(f)})")
    if problems:
        return None, problems
    obj = cls(**values)
    if hasattr(obj, "check"):  # rules between fields
        problems = [f"{where} {p}" for p in obj.check()]
    return (None, problems) if problems else (obj, [])


def describe(field: dataclasses.Field[Any]) -> str:
    m = field.metadata
    return f"{m['meaning']}; {allowed(m)}" if m["choices"] or m["unit"] else m["meaning"]


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def table_of(cls: type) -> list[dict[str, str]]:
    """Rows name, default, unit, allowed, meaning: the parameter table of help, `params` and the documentation."""
    rows = []
    for f in dataclasses.fields(cls):
        hint, _ = type_of(cls, f.name)
        base = get_origin(hint) or hint
        if not f.metadata or dataclasses.is_dataclass(base):
            continue
        m = f.metadata
        words = {bool: "true, false", str: "text", tuple: "list", dict: "table", datetime: "date, time"}
        unbounded = not m["choices"] and math.isinf(m["lo"]) and math.isinf(m["hi"])
        rows.append(
            {
                "name": f.name,
                "default": "required"
                if f.default is dataclasses.MISSING
                else ""
                if f.default in (None, "", ())
                else str(f.default),
                "unit": m["unit"],
                "allowed": words.get(base, "number") if unbounded else allowed(m).removesuffix(f" {m['unit']}"),
                "meaning": m["meaning"],
            }
        )
    return rows


class MissingKey(InputError):
    """A stage needs a key, or a section, that the folder does not give."""


class NotApplicable(InputError):
    """A stage finds that the folder has nothing for it to do: a film without a foot has no cone. Not a failure."""


@dataclasses.dataclass(frozen=True)
class Section:
    """One table of the file; `name` is its TOML name."""

    name: ClassVar[str]


@dataclasses.dataclass(frozen=True)
class FileSection(Section):
    """A section that names a recording; `path` is where it lies (a glob stays a pattern)."""

    file: str = param(REQUIRED, "", "file in the experiment's folder")
    path: Path = Path()  # not a key of the file: set when the folder is read


def need(section: Section, *keys: str) -> list[Any]:
    """The values of `keys`, in order; MissingKey naming every one that is absent."""
    if problems := lacking(section, *keys):
        raise MissingKey(problems)
    return [getattr(section, k) for k in keys]


def lacking(section: Section, *keys: str) -> list[str]:
    """Which of the keys are absent, each in words with its remedy."""
    by_name = {f.name: f for f in dataclasses.fields(section)}
    missing = [k for k in keys if getattr(section, k) is None]
    return [f"[{section.name}] {k}: missing; give {k} = ... ({describe(by_name[k])})" for k in missing]
