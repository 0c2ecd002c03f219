"""Experiment and campaign folders: read, inherited, validated as a whole; never written to.

`open_experiment` and `open_campaign` raise InputError with every problem found (file, section, key, value, what is
allowed), so that a folder is mended in one go.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from jumpvision.base import notebook as reprs
from jumpvision.base.schema import InputError, Toml, closest, read

from .labels import Labels, labels_of
from .model import considered_of, model_of, model_tables, own_of, read_toml
from .names import alike, file_problem, name_problem
from .overrides import TABLES
from .parameters import PARAMS
from .sections import SECTIONS, Calibration, Header, Section

S = TypeVar("S", bound=Section)
EXPERIMENT, CAMPAIGN = "experiment.toml", "campaign.toml"


@dataclass(frozen=True)
class Experiment:
    """One validated experiment folder.

    sections: by TOML name, only those given. params: stage name -> table of parameters, not yet checked.
    campaign: the folder whose campaign.toml it inherits, or None.
    """

    path: Path
    name: str
    header: Header
    sections: Toml
    params: Mapping[str, Toml]
    campaign: Path | None = None

    @property
    def ground(self) -> str:
        return self.header.ground

    def section(self, cls: type[S]) -> S | None:
        """The section of this type, or None."""
        found = self.sections.get(cls.name)
        return found if isinstance(found, cls) else None

    def required(self, cls: type[S]) -> S:
        """The section of this type. InputError where it is not given."""
        if (found := self.section(cls)) is None:
            raise InputError([f"{self.path / EXPERIMENT}: [{cls.name}]: missing"])
        return found

    def __fspath__(self) -> str:
        return str(self.path)

    _repr_html_ = reprs.experiment


@dataclass(frozen=True)
class Campaign:
    """A folder of experiments, in the order of their folder names."""

    path: Path
    experiments: tuple[Experiment, ...]
    excluded: Mapping[str, str] = field(default_factory=dict)  # experiment name -> reason

    @functools.cached_property
    def _by_name(self) -> dict[str, Experiment]:
        return {e.name: e for e in self.experiments}

    def __getitem__(self, name: str) -> Experiment:
        """The experiment of this name."""
        if name not in self._by_name:
            raise InputError([f"{self.path}: no experiment '{name}'{closest(name, self._by_name)}"])
        return self._by_name[name]

    def __iter__(self) -> Iterator[Experiment]:
        return iter(self.experiments)

    def __fspath__(self) -> str:
        return str(self.path)

    _repr_html_ = reprs.campaign


def is_campaign(path: Path) -> bool:
    """A campaign is a folder without experiment.toml of its own that holds experiment folders or a campaign.toml."""
    return not (path / EXPERIMENT).exists() and ((path / CAMPAIGN).exists() or any(path.glob(f"*/{EXPERIMENT}")))


def folders_below(path: Path) -> tuple[list[Path], list[Path]]:
    """(what can be opened at and below a folder: experiments and campaigns; experiment folders that belong to none).

    Hidden folders are passed over. An experiment inside another's folder belongs to none.
    """
    tops = [path] if (path / EXPERIMENT).exists() else []
    inside = [Path(at) for at, files in _walk(path) if EXPERIMENT in files and Path(at) != path]
    owners = {f: f.parent for f in inside}
    campaigns = [f for f in sorted({*owners.values()}) if not (f / EXPERIMENT).exists()]
    return tops + campaigns, [f for f, owner in owners.items() if owner not in campaigns]


def _walk(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Folders at and below a folder in order, but hidden ones, with the names of their files."""
    for at, folders, files in os.walk(path):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        yield at, files


def open_experiment(path: str | os.PathLike[str], **options: Any) -> Experiment:
    """The experiment folder at `path`, inheriting campaign.toml of the folder above; options as in open_campaign."""
    folder = _folder(path)
    if not (folder / EXPERIMENT).exists():
        raise InputError(
            [
                f"{folder}: no {EXPERIMENT} in this folder; jumpvision init {folder} writes one from the recordings in "
                f"it, jumpvision open {folder} shows them"
            ]
        )
    defaults, problems = _defaults(folder.resolve().parent)
    experiment, more = _read(folder, defaults, **options)
    if problems or more or experiment is None:
        raise InputError(problems + more)
    return experiment


def of_recording(
    file: Path, section: str, *, pipeline: Mapping[str, Toml] | None = None, overrides: Mapping[str, Toml] | None = None
) -> Experiment:
    """The experiment of one recording, `section`, without an experiment.toml; named as the file. Raises InputError."""
    own = {"ground": "hard", section: {"file": file.name}, "name": file.stem}
    experiment, problems = _made(own, file.absolute().parent, file, (None, {}), pipeline=pipeline, overrides=overrides)
    if experiment is None:
        raise InputError(problems)
    return experiment


def open_campaign(
    path: str | os.PathLike[str],
    *,
    pipeline: Mapping[str, Toml] | None = None,
    overrides: Mapping[str, Toml] | None = None,
) -> Campaign:
    """Every experiment folder below `path`.

    pipeline: parameters by stage, under those of the folder. overrides: by section or stage, over them.
    Raises InputError with the problems of all experiments.
    """
    folder = _folder(path)
    defaults, problems = _defaults(folder.resolve())
    found: list[Experiment] = []
    excluded: dict[str, str] = {}
    names: dict[str, Path] = {}
    for file in sorted(folder.glob(f"*/{EXPERIMENT}")):
        experiment, more = _read(file.parent, defaults, pipeline=pipeline, overrides=overrides)
        problems += more
        if experiment is None:
            continue
        if (same := alike(experiment.name)) in names:
            problems.append(
                f"{file}: name = '{experiment.name}': also the name of {names[same]}; names must be unique, for "
                "every disk (upper and lower case count as the same)"
            )
        names[same] = file
        if experiment.header.exclude:
            excluded[experiment.name] = experiment.header.exclude
        else:
            found.append(experiment)
    problems += _unlike(found)
    if not names and not problems:
        problems.append(f"{folder}: no experiment folders (folders with an {EXPERIMENT}) in this campaign")
    if problems:
        raise InputError(problems)
    return Campaign(folder, tuple(found), excluded)


def _unlike(experiments: Iterable[Experiment]) -> list[str]:
    """Problems of what cannot be compared: times of which only some say how far they are from UTC, labels that are
    numbers here and words there."""
    first: dict[str, dict[str, tuple[Experiment, object]]] = {}
    for e in experiments:
        for key, kind, value in _comparable(e):
            first.setdefault(key, {}).setdefault(kind, (e, value))
    return [
        f"{e.path / EXPERIMENT}: {key} = {value!s}: {kind}; {other} in {named.name}: must be alike in all"
        for key, kinds in first.items()
        if len(kinds) == 2
        for (other, (named, _)), (kind, (e, value)) in [kinds.items()]
    ]


def _comparable(e: Experiment) -> Iterator[tuple[str, str, object]]:
    """(key, in words what kind of value, the value) of what is compared between experiments."""
    if (at := e.header.recorded) is not None:
        yield "recorded", "with an offset from UTC" if at.tzinfo else "without an offset from UTC", at
    for name, value in labels.values.items() if (labels := e.section(Labels)) else ():
        yield f"[labels] {name}", "words" if isinstance(value, str) else "a number", value


def open_folder(
    path: str | os.PathLike[str],
    *,
    model: Path | None = None,
    pipeline: Mapping[str, Toml] | None = None,
    overrides: Mapping[str, Toml] | None = None,
) -> Experiment | Campaign:
    """The experiment, or the campaign, at `path`. model: a model.toml whose [model] and [robot] come over the folder's.

    pipeline: parameters by stage, under those of the folder. overrides: by section or stage, over all others.
    Raises InputError with every problem.
    """
    if model is not None:
        overrides = merged(model_tables(model), overrides or {})
    folder = folder_of(path)
    opened = open_campaign if folder.is_dir() and is_campaign(folder) else open_experiment
    return opened(folder, overrides=overrides, pipeline=pipeline)


def folder_of(path: str | os.PathLike[str]) -> Path:
    """The folder meant by a path: itself, or that of the experiment.toml or campaign.toml it names."""
    path = Path(path)
    return path.parent if path.name in (EXPERIMENT, CAMPAIGN) and path.is_file() else path


def _folder(path: str | os.PathLike[str]) -> Path:
    folder = folder_of(path)
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        alone = f"; of a film alone: jumpvision track {folder}, or piv" if folder.exists() else ""
        raise InputError(
            [f"{folder}: {what}; give an experiment folder (with {EXPERIMENT}) or a folder of them{alone}"]
        )
    return folder


def _defaults(folder: Path) -> tuple[tuple[Path | None, dict[str, Any]], list[str]]:
    """campaign.toml of a folder as (folder, tables)."""
    file = folder / CAMPAIGN
    if not file.exists():
        return (None, {}), []
    table, problems = read_toml(file)
    problems += [
        f"{file}: {key} = {table[key]!r}: an experiment's own key; remove it from {CAMPAIGN}"
        for key in ("name", "recorded", "order")
        if key in table
    ]
    return (folder, table), problems


def merged(low: Toml, high: Toml) -> dict[str, Any]:
    """Tables of `high` over those of `low`, key by key."""
    out = dict(low)
    for key, value in high.items():
        both = isinstance(value, Mapping) and isinstance(out.get(key), Mapping)
        out[key] = merged(out[key], value) if both else value
    return out


def _read(
    folder: Path,
    defaults: tuple[Path | None, Toml],
    *,
    pipeline: Mapping[str, Toml] | None = None,
    overrides: Mapping[str, Toml] | None = None,
) -> tuple[Experiment | None, list[str]]:
    file = folder / EXPERIMENT
    own, problems = read_toml(file)
    if problems:
        return None, problems
    return _made(own, folder, file, defaults, pipeline=pipeline, overrides=overrides)


def _made(
    own: Toml,
    folder: Path,
    file: Path,
    defaults: tuple[Path | None, Toml],
    *,
    pipeline: Mapping[str, Toml] | None,
    overrides: Mapping[str, Toml] | None,
) -> tuple[Experiment | None, list[str]]:
    """The experiment of its own tables over the campaign's; file: to name in its problems."""
    campaign, inherited = defaults
    table = merged({"params": pipeline or {}}, merged(inherited, own))
    overrides = overrides or {}
    table = merged(table, {k: v for k, v in overrides.items() if k != "params"})
    table = merged(table, {"params": overrides.get("params", {})})

    where = f"{file}:"
    if other := _other_schema(table.get("schema", SCHEMA)):
        return None, [f"{where} schema = {table['schema']}: {other}"]
    header, checked, problems = _checked(table, where, file)
    sections = dict(checked)
    for key, section in checked.items():
        file_name = table[key].get("file")
        if isinstance(file_name, str) and _names_a_file(key):
            problem = file_problem(folder, campaign, file_name)
            problems += [f"{where} [{key}] file = '{file_name}': {problem}"] if problem else []
            if section is not None:
                sections[key] = replace(section, path=(folder / file_name).absolute())
    if header is None or problems:
        return None, problems
    name = header.name or folder.resolve().name
    if problem := name_problem(name):
        return None, [f"{where} name = {name!r}: {problem}; give name = ... in {file.name}"]
    return Experiment(folder, name, header, sections, table.get("params", {}), campaign), []


def without_folder(table: Toml, where: str) -> Experiment:
    """The experiment that tables describe as experiment.toml would, without recordings. Raises InputError."""
    header, sections, problems = _checked(table, where)
    problems += [f"{where} [{k}]: a recording; it needs a folder" for k in sections if _names_a_file(k)]
    if header is None or problems:
        raise InputError(problems)
    return Experiment(Path(where), header.name or where, header, sections, table.get("params", {}))


def _names_a_file(section: str) -> bool:
    return "file" in getattr(SECTIONS.get(section), "__dataclass_fields__", ())


def _checked(table: Toml, where: str, file: Path | None = None) -> tuple[Header | None, Toml, list[str]]:
    """(header, sections by name, problems) of the tables of an experiment. where: to name; file: that they stand in."""
    known = {*SECTIONS, *TABLES, "params"}
    problems = [
        f"{where} {k} = {v!r}: must be a table, written [{k}]"
        for k, v in table.items()
        if k in known and not isinstance(v, Mapping)
    ]
    tables = {k: v for k, v in table.items() if isinstance(v, Mapping) and k not in _HEADER}
    header, more = read(Header, {k: v for k, v in table.items() if k not in tables and k not in known}, where)
    problems += more
    sections: dict[str, Any] = {}
    written = tables.get("mechanism", {})
    mechanisms, more = own_of(written, f"{where} [mechanism]", file) if written else ({}, [])
    problems += more
    for key, value in tables.items():
        if key == "labels":
            sections[key], more = labels_of(value, f"{where} [{key}]")
        elif key in ("model", "diagnosis"):
            parse = model_of if key == "model" else considered_of
            sections[key], more = parse(value, f"{where} [{key}]", written, mechanisms)
        elif key in SECTIONS:
            sections[key], more = read(SECTIONS[key], value, f"{where} [{key}]")
        elif key not in known:
            more = [f"{where} [{key}]: unknown section{closest(key, known)}"]
        else:
            more = []
        problems += more
    return header, sections, problems + _params(tables.get("params", {}), where)


_HEADER = {f.name for f in fields(Header)}
SCHEMA = 1


def _other_schema(number: object) -> str:
    """What to do about a folder of another format, "" for the present one (other types are refused with the rest)."""
    if isinstance(number, bool) or not isinstance(number, int) or number == SCHEMA:
        return ""
    if number > SCHEMA:
        return f"newer than this jumpvision reads ({SCHEMA}); update it: pip install --upgrade jumpvision"
    return f"older than any format there was; write schema = {SCHEMA} and run jumpvision check on the folder"


def _params(table: Toml, where: str) -> list[str]:
    """Problems of [params.*] tables; the stages declare what is allowed."""
    problems = []
    for stage, values in table.items():
        if stage not in PARAMS:
            problems.append(f"{where} [params.{stage}]: unknown stage{closest(stage, PARAMS)}")
        else:
            problems += read(PARAMS[stage], values, f"{where} [params.{stage}]")[1]
    return problems


UNMARKED = "rod_track", "crater_depth", "piv_field"  # of which no picture is read that marks could stand in


def exact_scales(experiments: Iterable[Experiment]) -> str:
    """One note on all sections whose scale is taken as exact, "" where none is; marks bring their own uncertainty."""
    bare: dict[str, None] = {}
    for e in experiments:
        calibration = e.section(Calibration)
        for name, section in e.sections.items():
            marked = calibration is not None and calibration.marks and name not in UNMARKED
            scaled = name == "rod_track" or getattr(section, "scale", None)
            if scaled and not section.scale_sigma and not marked:
                bare[f"[{name}]"] = None
    if not bare:
        return ""
    return (
        f"the scale of {', '.join(bare)} is taken as exact, so no sigma holds its error, which all experiments share: "
        "give scale_sigma (its standard uncertainty, m/px; of [rod_track] a share), or marks in [calibration]"
    )
