"""provenance.json: what made the results that lie beside it; and nothing but those results lies there as one of ours.

A result of an earlier run stays only while it is what this folder, with this run's parameters, would give: its key is
compared. Files that no run of ours has written are never touched.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import TypedDict

from jumpvision.base.record import plain
from jumpvision.base.schema import InputError, Toml
from jumpvision.base.storage import sha256, write_aside
from jumpvision.experiment import files
from jumpvision.experiment.inputs.sections import Header

from .entries import CorruptEntry, receipt_of, versions
from .stage import STAGES
from .workspace import Workspace


class Made(TypedDict):
    """Of a stage whose results lie there: its key, their names, the versions of packages that made them."""

    key: str
    files: list[str]
    versions: Mapping[str, str]


def read_provenance(results: Path) -> Toml:
    """What the last run wrote; {} where there is none that can be read."""
    try:
        found = json.loads((results / files.PROVENANCE).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    kinds = {"outputs": dict, "made": dict, "versions": dict, "warnings": list}
    if not isinstance(found, dict) or not all(isinstance(found.get(k), kind) for k, kind in kinds.items()):
        return {}
    whole = all(isinstance(m, dict) and m.keys() >= {"key", "files", "versions"} for m in found["made"].values())
    return found if whole else {}


def settle(workspace: Workspace, command: str) -> list[str]:
    """End a run: its results lie there whole, those of earlier runs only where they still hold; say it all in
    provenance.json. Returns warnings of files of earlier runs that were changed since.
    """
    workspace.confirm()
    before = read_provenance(workspace.results)
    still = dict(_still_valid(workspace, before))
    notes = _withdraw(workspace, before, {f for made in still.values() for f in made["files"]})
    if workspace.steps or still:
        now = plain(_content(workspace, before, still, command))
        if now != {**before, "command": command}:  # of a run that changed nothing: it stays that of who made them
            pieces = json.JSONEncoder(indent=1).iterencode(now)  # of a film of pictures 100,000 names and digests
            write_aside(workspace.results / files.PROVENANCE, chain(pieces, ["\n"]))
    elif before:
        (workspace.results / files.PROVENANCE).unlink(missing_ok=True)
    return notes


def digest_of_results(results: Path) -> str:
    """Digest of the results of an experiment, without its pictures."""
    provenance = read_provenance(results)
    stages = provenance.get("versions", {}).get("stages", {})
    made = [m for name, m in provenance.get("made", {}).items() if name in stages]
    files = {f: provenance["outputs"].get(f) for m in made for f in m["files"]}
    return hashlib.sha256(json.dumps(files, sort_keys=True).encode()).hexdigest()


def _still_valid(workspace: Workspace, before: Toml) -> Iterator[tuple[str, Made]]:
    """Stages of earlier runs, not of this one, whose results are those of the folder as it is."""
    here = {s.stage for s in workspace.steps}
    common = {p: v for p, v in before.get("versions", {}).items() if p != "stages"}
    for output, stage in list(STAGES.items()):
        made = before.get("made", {}).get(stage.name)
        if made is None or stage.name in here:
            continue
        try:
            same = workspace.key(output) == made["key"] and output not in workspace.failed
        except (InputError, OSError):
            continue
        if same and all(_is(workspace.results / f, before["outputs"].get(f)) for f in made["files"]):
            yield stage.name, {"key": made["key"], "files": made["files"], "versions": {**common, **made["versions"]}}


def _withdraw(workspace: Workspace, before: Toml, still: set[str]) -> list[str]:
    """Remove results of earlier runs that are none of these inputs; what somebody has changed stays, with a warning."""
    ours = workspace.outputs.keys() | still
    owners = {o.file: s.name for o, s in STAGES.items() if hasattr(o, "file")}
    earlier = before.get("outputs", {})
    notes = []
    for name in sorted((earlier.keys() | owners.keys()) - ours):
        file = workspace.results / name
        if Path(name).name != name or not file.is_file():
            continue
        if _is(file, earlier.get(name)) or _in_cache(workspace.cache / owners.get(name, ""), name, file):
            file.unlink(missing_ok=True)
        elif name in earlier:
            notes.append(_put_by(file))
    return notes


def _put_by(file: Path) -> str:
    """Rename what somebody has changed, so that nothing takes it for a result of this run; a warning."""
    name = file.with_name(file.name + ".old")
    while name.exists():
        name = name.with_name(name.name + ".old")
    file.rename(name)
    return f"{file}: of an earlier run and changed since; it is no result of this one and was renamed to {name.name}"


def _is(file: Path, digest: str | None) -> bool:
    try:
        return digest is not None and sha256(file) == digest
    except OSError:
        return False


def _in_cache(stage: Path, name: str, file: Path) -> bool:
    """Whether a stage made this very file: one that a killed run has left, and never put down."""
    known = set()
    for entry in stage.glob("*") if stage.name else ():
        try:
            known.add(receipt_of(entry)["outputs"].get(name))
        except (CorruptEntry, OSError):
            continue
    return bool(known) and sha256(file) in known


def _content(workspace: Workspace, before: Toml, still: Mapping[str, Made], command: str) -> Mapping[str, object]:
    """The content of provenance.json."""
    stages = {s.name: s for s in STAGES.values()}
    made: Mapping[str, Made] = {
        **still,
        **{s.stage: {"key": s.key, "files": list(s.files), "versions": dict(s.versions)} for s in workspace.steps},
    }
    kept = {f: before["outputs"][f] for m in still.values() for f in m["files"]}
    used: dict[str, set[str]] = {p: set() for p in versions()}
    for m in made.values():
        for package, version in m["versions"].items():
            used.setdefault(package, set()).add(version)
    return {
        "versions": {
            **{p: ", ".join(sorted(v)) for p, v in used.items() if v},
            "stages": {n: stages[n].version for n in made if not stages[n].picture},
        },
        "parameters": {n: asdict(workspace.parameters(stages[n])) for n in made if stages[n].params},
        "inputs": dict(sorted(workspace.inputs.items())),
        "outputs": dict(sorted({**kept, **workspace.outputs}.items())),
        "made": {n: _without_repeats(m, used) for n, m in made.items()},
        "warnings": [
            *(t for t in before.get("warnings", []) if str(t).partition(":")[0] in still),
            *(f"{s.stage}: {w['message']}" for s in workspace.steps for w in s.warnings),
        ],
        "command": command,
        **_terms(workspace.experiment.header),
    }


def _terms(header: Header) -> Mapping[str, str]:
    """How to cite the recordings, and on what terms they may be used, where that is said."""
    return {k: getattr(header, k) for k in ("citation", "license") if getattr(header, k)}


def _without_repeats(made: Made, used: Mapping[str, set[str]]) -> Made:
    """Versions of a stage only where not all stages have the same."""
    own = {p: v for p, v in made["versions"].items() if len(used[p]) > 1}
    return {"key": made["key"], "files": made["files"], "versions": own}


def settle_tables(
    results: Path,
    made_of: Mapping[str, str],
    written: Iterable[str],
    command: str,
    *,
    warnings: Sequence[Mapping[str, object]] = (),
    lasting: Iterable[str] = (),
) -> list[str]:
    """End a campaign's run, and say so in campaign.json: tables of earlier runs stay only while the experiments are
    what they were made of.

    made_of: digest of each experiment by name; written: names of this run's tables; lasting: of those that stay though
    they are of other values; warnings: of the experiments, beside those of before where only some stages were asked for
    and nothing has changed. Returns notes on what was left.
    """
    file = results / files.CAMPAIGN
    try:
        before = json.loads(file.read_text(encoding="utf-8"))
        earlier, then = dict(before["tables"]), dict(before["experiments"])
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        earlier, then = {}, {}
    notes = [
        f"{results / name}: results of an experiment that the campaign no longer has; delete them if they are no use"
        for name in sorted(then.keys() - made_of.keys())
        if (results / name).is_dir()
    ]
    tables = {name: sha256(results / name) for name in sorted(set(written))}
    for name in sorted(earlier.keys() - tables.keys()):
        old = results / name
        if Path(name).name != name or not old.is_file():
            continue
        if not _is(old, earlier[name]):
            notes.append(_put_by(old))
        elif then == made_of or name in lasting:
            tables[name] = earlier[name]
        else:
            old.unlink(missing_ok=True)
    if of_others := sorted(set(lasting) & tables.keys() - set(written)) if then != made_of else []:
        notes.append(f"{', '.join(of_others)} in {results}: of other values than these results; they were left alone")
    said = [*warnings]
    if lasting and then == made_of:  # only some stages were asked for
        said = [*before.get("warnings", []), *(w for w in said if w not in before.get("warnings", []))]
    now = {"tables": tables, "experiments": dict(sorted(made_of.items())), "warnings": said, "command": command}
    known = before if earlier or then else {}
    if now != known and (tables or known):
        write_aside(file, json.dumps(now, indent=1) + "\n")
    return notes
