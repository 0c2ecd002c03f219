"""Make the text of keys.md, the tables of every key of a folder, of the stages; written when the site is
built, printed by `python docs/tables.py`."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path

from jumpvision.base.schema import KINDS, table_of
from jumpvision.experiment.inputs.parameters import PARAMS
from jumpvision.experiment.inputs.sections import SECTIONS, Header, RobotSigma, Section
from jumpvision.experiment.workflow.stage import Input, results_stages
from jumpvision.films.frames.opening import READERS
from jumpvision.jumper.mechanisms.registry import MECHANISMS, ModelParameters

TARGET = Path(__file__).with_name("keys.md")


def rows(table: Sequence[Mapping[str, object]]) -> str:
    """A list of rows as a markdown table."""
    head = list(table[0])
    body = [" | ".join(str(r[k]).replace("|", "\\|") for k in head) for r in table]
    return "\n".join([f"| {' | '.join(head)} |", "|" + "---|" * len(head), *(f"| {b} |" for b in body)])


def mechanisms() -> list[dict[str, str]]:
    """The vocabulary of causes as rows."""
    return [
        {"mechanism": k, "parameters": ", ".join(m.names), "ground": ", ".join(m.grounds), "meaning": m.meaning}
        for k, m in MECHANISMS.items()
    ]


def films() -> list[dict[str, str]]:
    """The film formats as rows: suffixes, and what their reader says of itself."""
    suffixes: dict[tuple[str, str], list[str]] = {}
    for suffix, reader in READERS.items():
        suffixes.setdefault(reader, []).append(suffix)
    classes = {r: getattr(importlib.import_module(f"jumpvision.films.frames.{r[0]}"), r[1]) for r in suffixes}
    return [
        {"suffix": " ".join(of), "film": " ".join(inspect.getdoc(classes[reader]).split("\n\n")[0].split())}
        for reader, of in suffixes.items()
    ]


def stages() -> list[dict[str, str]]:
    """Every stage in the order of a run: what it reads and makes."""

    def words(i: Input) -> str:
        kind = f"[{i.type.name}]" if issubclass(i.type, Section) else getattr(i.type, "file", "the header")
        return kind + ("?" if i.optional else "")

    return [
        {"stage": s.name, "makes": s.help, "from (? where there is one)": ", ".join(words(i) for i in s.inputs)}
        for s in results_stages()
    ]


def text() -> str:
    """The whole page."""
    parts = [
        "# Every key, with its default, unit, range and meaning",
        "Made from the declarations in the code when the site is built; `jumpvision params` prints the stages' "
        "part. SI units. A section may be left out until a stage needs it. "
        "The thesis is Aguilar ([physics.md](physics.md)).",
        "## experiment.toml and campaign.toml",
        f"### above the first section\n\n{rows(table_of(Header))}",
    ]
    for name, cls in {**SECTIONS, "robot.sigma": RobotSigma}.items():
        parts.append(f"### [{name}]\n\n{inspect.cleandoc(cls.__doc__ or '')}\n\n{rows(table_of(cls))}")
    parts += [
        "### [labels]\n\nAnything else that is known of a recording, numbers or words under names of your own: "
        '`temperature_C = 22.5`, `operator = "B"`. In campaign.toml for all; an experiment\'s own win. With the '
        "frequency, amplitude and delay of `[actuation]`, the packing, `session` and the order they are what a number "
        "may go with that differs between recordings (diagnosis.md). Where neither `order` nor `recorded` is given, "
        "the order is that of the stamps in the films' own headers; else the whole number that every folder's name "
        "begins or ends with (`jump-15`), each another; else that of the files' dates, unless all lie within an hour, "
        "as copies do. What was used is said.",
        "### [model]\n\n`terms` lists mechanisms; their parameters stand beside it. `[model.fit]` holds ranges "
        "`[low, high]` of parameters that may be re-fitted, `[model.sigma]` standard uncertainties of given ones, "
        "`[model.laws]` laws of the bed against its volume fraction (granular.md).",
        rows(mechanisms()),
        rows(table_of(ModelParameters)),
        "## Kinds of warnings",
        rows([{"kind": k, "of what": what} for k, what in KINDS.items()]),
        "## Film formats\n\nOf every `file` above that is a film or a picture; also a folder of pictures, or a "
        "pattern such as `frames/*.png`.",
        rows(films()),
        "## Stages\n\nEach is a command, a function of a notebook (`jv.track`) and a name in a pipeline's `stages`. "
        "They run in this order.",
        rows(stages()),
        "## Stage parameters\n\nIn `[params.<stage>]` of experiment.toml, campaign.toml or a pipeline file; "
        "`--set stage.key=value` on the command line wins.",
    ]
    for name, cls in PARAMS.items():
        parts.append(f"### [params.{name}]\n\n{inspect.cleandoc(cls.__doc__ or '')}\n\n{rows(table_of(cls))}")
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    print(text(), end="")
