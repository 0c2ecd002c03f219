"""How records and folders show themselves in a notebook: one compact HTML table, then the pictures."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Protocol

from .schema import Section


class Experiment(Protocol):
    """What is shown of a folder."""

    @property
    def name(self) -> str: ...
    @property
    def ground(self) -> str: ...
    @property
    def path(self) -> Path: ...
    @property
    def sections(self) -> Mapping[str, Section]: ...


class Campaign(Protocol):
    """What is shown of a folder of them."""

    @property
    def path(self) -> Path: ...
    @property
    def experiments(self) -> Sequence[Experiment]: ...
    @property
    def excluded(self) -> Mapping[str, str]: ...


def record(record: Any) -> str:
    """A record's values, table or data set, and the figures that a notebook's record can draw."""
    if hasattr(record, "values"):
        body = values(record.values)
    elif hasattr(record, "table"):
        body = record.table.to_html(max_rows=8, border=0)  # rows of a long table
    else:
        body = record.field._repr_html_()
    return page(f"{type(record).__name__} ({record.file})", body, getattr(record, "pictures", list)())


def experiment(experiment: Experiment) -> str:
    """The sections of an experiment with what is given in them."""
    rows = [
        {"section": f"[{name}]", "given": ", ".join(f"{k} = {short(v)}" for k, v in given(section).items())}
        for name, section in experiment.sections.items()
    ]
    return page(f"Experiment {experiment.name} ({experiment.ground} ground, {experiment.path})", table(rows))


def campaign(campaign: Campaign) -> str:
    """One row an experiment, with what was recorded."""
    rows = [{"experiment": e.name, "ground": e.ground, "sections": ", ".join(e.sections)} for e in campaign.experiments]
    rows += [{"experiment": n, "ground": "", "sections": f"excluded: {why}"} for n, why in campaign.excluded.items()]
    return page(f"Campaign of {len(campaign.experiments)} experiments ({campaign.path})", table(rows))


def given(section: Section) -> dict[str, object]:
    """What a section holds besides its defaults."""
    values = {f.name: getattr(section, f.name) for f in fields(section) if f.name != "path"}
    defaults = {f.name: f.default for f in fields(section)}
    return {k: v for k, v in values.items() if v != defaults[k] and v not in ((), {})}


def page(title: str, body: str, pictures: Iterable[bytes] = ()) -> str:
    """A heading, the body and PNG pictures."""
    images = "".join(
        f'<div><img alt="{html.escape(title)}" style="max-width:100%" '
        f'src="data:image/png;base64,{base64.b64encode(png).decode()}"></div>'
        for png in pictures
    )
    return f"<div><div><b>{html.escape(title)}</b></div>{body}{images}</div>"


def table(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows with the same keys."""
    if not rows:
        return ""
    head = "".join(f"<th>{html.escape(str(k))}</th>" for k in rows[0])
    lines = ("".join(f"<td>{html.escape(short(v))}</td>" for v in row.values()) for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(f'<tr>{c}</tr>' for c in lines)}</tbody></table>"


def values(data: Mapping[str, Any]) -> str:
    """A JSON object: one row a key; of measured values also the sigma and unit."""
    measured = [v for v in data.values() if isinstance(v, Mapping) and "value" in v]
    columns = ("value", "sigma", "unit") if measured and len(measured) == len(data) else ("value",)
    return table(
        [{"": k, **({c: v.get(c) for c in columns} if len(columns) > 1 else {"value": v})} for k, v in data.items()]
    )


def short(value: object) -> str:
    """One cell: numbers to five figures, lists and tables by their length."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, list | tuple | dict) and len(value) > 3:
        return f"{len(value)} {'keys' if isinstance(value, dict) else 'values'}"
    if isinstance(value, list | tuple):
        return ", ".join(map(short, value))
    if isinstance(value, dict):
        return ", ".join(f"{k} {short(v)}" for k, v in value.items())
    return str(value)
