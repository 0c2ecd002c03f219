"""[model], [mechanism.*] and [diagnosis] of experiment.toml, campaign.toml and model.toml: what is simulated, with the
parameters, ranges, priors and laws, and what else a diagnosis considers."""

from __future__ import annotations

import functools
import json
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from jumpvision.base.schema import InputError, Toml, check_value, closest, param, read
from jumpvision.base.storage import irregular

from .sections import Section

if TYPE_CHECKING:
    from jumpvision.jumper.mechanisms.record import Mechanism
    from jumpvision.jumper.physics.packing import Laws

LARGEST = 10**6  # bytes of a TOML file
DEEPEST = 100  # parts of a key
QUOTED = re.compile(r""""(?:[^"\\]|\\.)*"|'[^']*'""")
OwnTables = Toml  # the user's tables [mechanism.NAME], as TOML has them


@dataclass(frozen=True)
class ModelSpec(Section):
    """[model]: the simulation to be tested, as a list of mechanisms with parameters (docs/physics.md section 6)."""

    name: ClassVar[str] = "model"
    terms: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    fit: Mapping[str, tuple[float, ...]] = field(default_factory=dict)  # re-fittable parameters: (low, high)
    sigma: Mapping[str, float] = field(default_factory=dict)  # priors on given parameters
    laws: Laws | None = None  # of the bed's parameters against its volume fraction, before `parameters`
    own: OwnTables = field(default_factory=dict)  # [mechanism.*] of those of its terms that are the user's own

    @property
    def mechanisms(self) -> tuple[Mechanism, ...]:
        """The records of `own`."""
        return mechanisms_of(self.own)


@dataclass(frozen=True)
class Considered(Section):
    """[diagnosis]: mechanisms of the user's own that a diagnosis tries beside the vocabulary."""

    name: ClassVar[str] = "diagnosis"
    consider: tuple[str, ...] = param((), "", "names of [mechanism.*] to be tried as causes")
    own: OwnTables = field(default_factory=dict)

    @property
    def mechanisms(self) -> tuple[Mechanism, ...]:
        """The records of `consider`."""
        return mechanisms_of(self.own)


def mechanisms_of(tables: OwnTables) -> tuple[Mechanism, ...]:
    """The records of checked [mechanism.*] tables."""
    return _built(json.dumps(tables)) if tables else ()


@functools.lru_cache(64)
def _built(tables: str) -> tuple[Mechanism, ...]:
    from jumpvision.jumper.mechanisms.own import read_own

    return tuple(read_own(json.loads(tables), "[mechanism]")[0].values())


def own_of(table: object, where: str, file: Path | None = None) -> tuple[dict[str, Mechanism], list[str]]:
    """(mechanisms by name, problems) of the [mechanism.*] tables. file: where they stand, for the line's number."""
    from jumpvision.jumper.mechanisms.own import read_own

    found, problems = read_own(table, where)
    return found, [_with_line(p, file) for p in problems] if file else problems


def _with_line(problem: str, file: Path) -> str:
    """The problem with the number of the line of its law, where the file has it."""
    named = re.search(r"\[mechanism\.(\w+)\] law = ", problem)
    if not named:
        return problem
    inside = False
    for number, line in enumerate(file.read_text(encoding="utf-8-sig").splitlines(), 1):
        if line.strip().startswith("["):
            inside = line.strip().startswith(f"[mechanism.{named[1]}]")
        elif inside and re.match(r"\s*law\s*=", line):
            return problem.replace(f"{file}:", f"{file}, line {number}:", 1)
    return problem


def _endless_key(text: str) -> int:
    """The line of a key of more than DEEPEST parts, 0 where none is: a.a.a... of 100,000 takes tomllib minutes."""
    for number, line in enumerate(text.splitlines(), 1):
        if line.count(".") > DEEPEST and any(p.count(".") > DEEPEST for p in re.split(r"[=,{}]", QUOTED.sub("", line))):
            return number
    return 0


def read_toml(file: Path) -> tuple[dict[str, Any], list[str]]:
    try:
        if problem := irregular(file):
            return {}, [f"{file}: {problem}"]
        if (size := file.stat().st_size) > LARGEST:
            return {}, [f"{file}: {size} bytes; at most {LARGEST} are read: put tables into recordings, not keys"]
        text = file.read_text(encoding="utf-8-sig")
        if line := _endless_key(text):
            deep = f"a key of more than {DEEPEST} parts, joined by dots: damaged? None has more than four"
            return {}, [f"{file}: line {line}: {deep}"]
        return tomllib.loads(text), []
    except tomllib.TOMLDecodeError as e:
        return {}, [f"{file}: not valid TOML: {e}"]
    except RecursionError:
        return {}, [f"{file}: not valid TOML: lists or tables within each other more than some hundred deep"]
    except UnicodeDecodeError as e:
        return {}, [f"{file}: not UTF-8 text (byte {e.start}); save it as UTF-8"]
    except ValueError as e:  # a number of more digits than Python reads
        return {}, [f"{file}: not valid TOML: {e}"]
    except OSError as e:
        return {}, [f"{file}: cannot be read: {e.strerror}"]


def tables_of(file: Path) -> dict[str, Any]:
    """What a TOML file holds. InputError where it cannot be read."""
    tables, problems = read_toml(file)
    if problems:
        raise InputError(problems)
    return tables


def read_model(file: Path) -> ModelSpec:
    """[model] of a TOML file such as model.toml; its other tables are left alone. InputError with every problem."""
    table, spec = tables_of(file), None
    if not isinstance(table.get("model"), Mapping):
        raise InputError([f"{file}: [model]: missing; give terms and their parameters"])
    own, problems = own_of(table.get("mechanism", {}), f"{file}: [mechanism]", file)
    if not problems:
        spec, problems = model_of(table["model"], f"{file} [model]", table.get("mechanism", {}), own)
    if spec is None:
        raise InputError(problems)
    return spec


def model_tables(file: Path) -> dict[str, Any]:
    """[model], [mechanism] and [robot] of a model.toml as overrides of a folder's own. InputError: every problem."""
    read_model(file)
    return {k: v for k, v in tables_of(file).items() if k in ("model", "robot", "mechanism")}


def model_of(
    table: Toml, where: str, tables: OwnTables, own: Mapping[str, Mechanism]
) -> tuple[ModelSpec | None, list[str]]:
    """(the section, problems) of a [model] table; None where there are problems. where: file and section, to name.

    own: the mechanisms of the file's [mechanism.*], read from `tables`.
    """
    from jumpvision.jumper.mechanisms.own import parameters_with
    from jumpvision.jumper.mechanisms.registry import MECHANISMS

    every = {**MECHANISMS, **own}
    parameter_types = parameters_with(tuple(own.values()))
    declared = {f.name: f for f in fields(parameter_types)}
    problems: list[str] = []
    terms = table.get("terms", ())
    if not isinstance(terms, list | tuple) or not all(isinstance(t, str) for t in terms):
        problems.append(f"{where} terms = {terms!r}: must be a list of mechanisms")
        terms = ()
    problems += [
        f"{where} terms: unknown mechanism '{t}'{closest(t, every)}" for t in terms if t not in {*every, *tables}
    ]
    values = {k: v for k, v in table.items() if k not in ("terms", "fit", "sigma", "laws")}
    parameters, more = read(parameter_types, values, where)
    problems += more
    fit, sigma = table.get("fit", {}), table.get("sigma", {})
    for part, entries in (("fit", fit), ("sigma", sigma)):
        at = f"{where[:-1]}.{part}]"
        if not isinstance(entries, Mapping):
            problems.append(f"{at} = {entries!r}: must be a table")
            continue
        for key, value in entries.items():
            if key not in declared:
                problems.append(f"{at} {key}: unknown parameter{closest(key, declared)}")
            elif part == "sigma":
                _, problem = check_value(value, float, {**declared[key].metadata, "lo": 0.0, "hi": float("inf")})
                problems += [f"{at} {key} = {value!r}: {problem}"] if problem else []
            elif not (isinstance(value, list | tuple) and len(value) == 2):
                problems.append(f"{at} {key} = {value!r}: must be [low, high]")
            else:
                wrong = [p for p in (check_value(v, float, declared[key].metadata)[1] for v in value) if p]
                if not wrong and not value[0] < value[1]:
                    wrong = ["low must be below high"]
                problems += [f"{at} {key} = {value!r}: {p}" for p in wrong[:1]]
    laws = None
    if isinstance(table.get("laws"), Mapping):
        from jumpvision.jumper.physics.packing import laws_from

        laws, more = laws_from(table["laws"], f"{where[:-1]}.laws]")
        problems += more
    elif "laws" in table:
        problems.append(f"{where} laws = {table['laws']!r}: must be a table of laws of the bed's volume fraction")
    if problems or parameters is None:
        return None, problems
    given = {k: float(getattr(parameters, k)) for k in values}
    named = {n: tables[n] for n in own if n in terms}
    priors = {p.name: s for n in named for p in own[n].parameters if math.isfinite(s := p.prior(None).sigma)}
    ranges = {k: tuple(map(float, v)) for k, v in fit.items()}
    return ModelSpec(tuple(terms), given, ranges, priors | dict(sigma), laws, named), []


def considered_of(
    table: Toml, where: str, tables: OwnTables, own: Mapping[str, Mechanism]
) -> tuple[Considered | None, list[str]]:
    """(the section, problems) of a [diagnosis] table; own, tables: as in `model_of`."""
    found, problems = read(Considered, table, where)
    if found is None:
        return None, problems
    unknown = [n for n in found.consider if n not in own]
    if unknown:
        known = closest(unknown[0], own) if own else "; the folder has no [mechanism.*]"
        return None, [f"{where} consider: no mechanism '{unknown[0]}' of your own{known}"]
    return replace(found, own={n: tables[n] for n in found.consider}), []
