"""[model] of experiment.toml, campaign.toml and model.toml: mechanisms with parameters, ranges, priors and laws."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from jumpvision.base.schema import InputError, check_value, closest, read

from .sections import Section

if TYPE_CHECKING:
    from jumpvision.physics.packing import Laws


@dataclass(frozen=True)
class ModelSpec(Section):
    """[model]: the simulation to be questioned, as a list of mechanisms with parameters (docs/physics.md section 6)."""

    name: ClassVar[str] = "model"
    terms: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    fit: Mapping[str, tuple[float, ...]] = field(default_factory=dict)  # re-fittable parameters: (low, high)
    sigma: Mapping[str, float] = field(default_factory=dict)  # priors on given parameters
    laws: Laws | None = None  # of the bed's parameters against its volume fraction, before `parameters`


def read_toml(file: Path) -> tuple[dict[str, Any], list[str]]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig")), []
    except tomllib.TOMLDecodeError as e:
        return {}, [f"{file}: not valid TOML: {e}"]
    except UnicodeDecodeError as e:
        return {}, [f"{file}: not UTF-8 text (byte {e.start}); save it as UTF-8"]
    except OSError as e:
        return {}, [f"{file}: cannot be read: {e.strerror}"]


def read_model(file: Path) -> ModelSpec:
    """[model] of a TOML file such as model.toml; its other tables are left alone. InputError with every problem."""
    try:
        table, problems = read_toml(file)
    except OSError as e:
        raise InputError([f"{file}: cannot be read ({e.strerror}); name a TOML file with a [model]"]) from None
    spec = None
    if not problems and not isinstance(table.get("model"), Mapping):
        problems = [f"{file}: [model]: missing; give terms and their parameters"]
    elif not problems:
        spec, problems = model_of(table["model"], f"{file} [model]")
    if spec is None:
        raise InputError(problems)
    return spec


def model_tables(file: Path) -> dict[str, Any]:
    """[model] and [robot] of a model.toml as overrides of a folder's own. InputError with every problem."""
    read_model(file)
    return {k: v for k, v in read_toml(file)[0].items() if k in ("model", "robot")}


def model_of(table: Mapping[str, Any], where: str) -> tuple[ModelSpec | None, list[str]]:
    """(the section, problems) of a [model] table; None where there are problems. where: file and section, to name."""
    from jumpvision.mechanisms.registry import MECHANISMS, ModelParameters

    declared = {f.name: f for f in fields(ModelParameters)}
    problems: list[str] = []
    terms = table.get("terms", ())
    if not isinstance(terms, list | tuple) or not all(isinstance(t, str) for t in terms):
        problems.append(f"{where} terms = {terms!r}: must be a list of mechanisms")
        terms = ()
    problems += [
        f"{where} terms: unknown mechanism '{t}'{closest(t, MECHANISMS)}" for t in terms if t not in MECHANISMS
    ]
    values = {k: v for k, v in table.items() if k not in ("terms", "fit", "sigma", "laws")}
    parameters, more = read(ModelParameters, values, where)
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
        from jumpvision.physics.packing import laws_from

        laws, more = laws_from(table["laws"], f"{where[:-1]}.laws]")
        problems += more
    elif "laws" in table:
        problems.append(f"{where} laws = {table['laws']!r}: must be a table of laws of the bed's volume fraction")
    if problems or parameters is None:
        return None, problems
    given = {k: float(getattr(parameters, k)) for k in values}
    return ModelSpec(tuple(terms), given, {k: tuple(map(float, v)) for k, v in fit.items()}, dict(sigma), laws), []
