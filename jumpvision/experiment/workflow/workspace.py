"""Stages run on an experiment, their results kept.

`Workspace.make(Track)` walks back from the wanted record, computes what is missing or changed and keeps each result
under the hash of its inputs, parameters and version (`entries`). A recording that changes while it is read is no input.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import os
import sys
import time
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

from jumpvision.base.progress import KEEPER, Shared, setting
from jumpvision.base.record import Record
from jumpvision.base.schema import InputError, WarningRecord, read, warnings_in
from jumpvision.base.storage import (
    ChangedFile,
    Stamp,
    copy_aside,
    sha256,
    stamp,
)
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import MissingKey, NotApplicable, Section

from . import entries
from .entries import ATTEMPTS, CorruptEntry, Receipt
from .hashes import NOTHING, Hashed, Hashes
from .stage import STAGES, Input, Said, Stage, StageWarning, results_stages

R = TypeVar("R", bound=Record)


@dataclass(slots=True)
class Step:
    """What became of one stage in a run. versions: of the packages that made it; files: its results."""

    stage: str
    state: str  # "computed" | "cached"
    seconds: float
    warnings: list[WarningRecord]
    key: str
    versions: Mapping[str, str]
    files: Mapping[str, str]  # name: SHA-256


class NotCached(Exception):
    """A stage would have to be computed where only what is there already was asked for."""


class Workspace:
    """Results and cache of one experiment.

    results: folder of the result files. cache: folder shared by the experiments of a campaign.
    verify: hash every input again instead of trusting an unchanged size and modification time.
    computes: "all" that is not there yet, "pictures" alone, or "nothing"; else NotCached is raised.
    fresh: compute again what other versions of jumpvision, of Python or of a package have made.
    """

    def __init__(
        self,
        experiment: Experiment,
        results: Path,
        cache: Path,
        *,
        verify: bool = False,
        computes: str = "all",
        fresh: bool = False,
    ):
        self.experiment, self.results, self.cache, self.verify = experiment, Path(results), Path(cache), verify
        self.computes, self.fresh = computes, fresh
        self.steps: list[Step] = []
        self._made: dict[type, tuple[str, Record]] = {}
        self._failed: dict[type, Exception] = {}
        self._hashes = Hashes(self.cache, verify=verify)
        self._published: dict[Path, Stamp] = {}

    # -- what can be made ------------------------------------------------------------------------------------

    def missing(self, output: type) -> str:
        """Why `output` cannot be made from this experiment: "" or the sections it lacks, in words."""
        lack = self._lack(output)
        return f"{STAGES[output].name} needs {lack}" if lack else ""

    def _lack(self, kind: type) -> str:
        """The sections that are missing for a section or record to be there; "" when it can be had."""
        if issubclass(kind, Section):
            return "" if self.experiment.section(kind) is not None else f"[{kind.name}]"
        if kind is Experiment or kind is Said:
            return ""
        made = STAGES[kind]
        absent = {i.name: lack for i in made.inputs if (lack := self._lack(i.type))}
        for i in made.inputs:
            if i.name in absent and not i.optional:
                return absent[i.name]
        if made.any_of and all(name in absent for name in made.any_of):
            return " or ".join(dict.fromkeys(absent[n] for n in made.any_of))
        return ""

    # -- making ----------------------------------------------------------------------------------------------

    def make(self, output: type[R]) -> R:
        """The record, from the cache or computed, and its file in the results folder."""
        return cast(R, self._make(output)[1])

    @property
    def records(self) -> dict[type, Record]:
        """The records made so far, by type."""
        return {output: record for output, (_, record) in self._made.items()}

    @property
    def failed(self) -> set[type]:
        """Records that could not be made, or of which there are none."""
        return set(self._failed)

    def key(self, output: type) -> str:
        """The key that `output` has for the inputs and parameters as they are; nothing is computed.

        Raises MissingKey or InputError where it cannot be made.
        """
        if output in self._made:
            return self._made[output][0]
        made = STAGES[output]
        if why := self.missing(output):
            raise MissingKey([why])
        return self._hashed(made, {i.name: self._identity(i) for i in made.inputs})

    def _identity(self, i: Input) -> object:
        if i.type not in STAGES:
            return self._input(i)[0]
        if self._lack(i.type) or (i.optional and self._nothing_to_do(i.type)):
            return None
        return self.key(i.type)

    def said(self) -> Said:
        """What the stages that make results had to say, made now or in the cache; not those that read it themselves."""
        now = {s.stage: s.warnings for s in self.steps}
        out = Said()
        for made in results_stages():
            if not any(i.type is Said for i in made.inputs):
                warned = now[made.name] if made.name in now else self._said_before(made)
                out += [t for t in warned if t not in out]
        return out

    def _said_before(self, made: Stage) -> list[WarningRecord]:
        """What a stage that is not made now said of the folder as it is; nothing where it has not run."""
        if made.output in self._failed or self.missing(made.output):
            return []
        try:
            receipt = entries.receipt_of(entries.place(self.cache, made.name, self.key(made.output)))
            return [] if receipt["not_applicable"] else receipt["warnings"]
        except (CorruptEntry, InputError, OSError):
            return []

    def _nothing_to_do(self, output: type) -> bool:
        """Whether it is known that the stage finds nothing to do."""
        if output in self._failed:
            return isinstance(self._failed[output], NotApplicable)
        try:
            entry = entries.place(self.cache, STAGES[output].name, self.key(output))
            return bool(entries.receipt_of(entry)["not_applicable"])
        except (CorruptEntry, OSError):
            return False

    @property
    def outputs(self) -> dict[str, str]:
        """SHA-256 of the result files made, by name."""
        return {name: digest for s in self.steps for name, digest in s.files.items()}

    def confirm(self) -> None:
        """Put back what was removed or overwritten since: when a run ends its results lie there, and only its own."""
        for _ in range(ATTEMPTS):
            lost = [s for s in self.steps if any(not self._untouched(name) for name in s.files)]
            if not lost:
                return
            for s in lost:
                self._publish(entries.place(self.cache, s.stage, s.key), s.files)
        raise InputError(
            [f"{self.results}: another run, or a program, changes the results while they are written; run again"]
        )

    def _untouched(self, name: str) -> bool:
        try:
            return stamp(self.results / name) == self._published.get(self.results / name)
        except OSError:
            return False

    def _make(self, output: type) -> tuple[str, Record]:
        if output in self._made:
            return self._made[output]
        if output in self._failed:
            raise self._failed[output]
        try:
            self._made[output] = self._resolve(output)
        except Exception as e:
            self._failed[output] = e
            raise
        return self._made[output]

    def _resolve(self, output: type) -> tuple[str, Record]:
        made = STAGES[output]
        why = self.missing(output)
        if why:
            raise MissingKey([f"{self.experiment.path / 'experiment.toml'}: {why}"])
        keys: dict[str, object] = {}
        arguments: dict[str, object] = {}
        for i in made.inputs:
            keys[i.name], arguments[i.name] = self._input(i)
        if made.params:
            arguments["p"] = self.parameters(made)
        key = self._hashed(made, keys)
        entry = entries.place(self.cache, made.name, key)
        began = time.perf_counter()
        for attempt in range(ATTEMPTS):
            try:
                record, receipt = self._load(key, output)
                state = "cached"
            except (FileNotFoundError, CorruptEntry) as e:
                if self.computes == "nothing" or (self.computes == "pictures" and not made.picture):
                    raise NotCached(made.name) from None
                if isinstance(e, CorruptEntry):
                    warnings.warn(StageWarning("cache", f"{e}; computed again"), stacklevel=2)
                record, receipt = self._compute(made, arguments, key)
                state = "computed"
            try:
                self._publish(entry, receipt["outputs"])
                break
            except (FileNotFoundError, ChangedFile):  # the entry was pruned, or mended by another run, in between
                if attempt == ATTEMPTS - 1:
                    raise
        seconds, notes = time.perf_counter() - began, receipt["warnings"]
        self.steps.append(Step(made.name, state, seconds, notes, key, receipt["versions"], receipt["outputs"]))
        return key, record

    def _hashed(self, made: Stage, keys: Mapping[str, object]) -> str:
        """The key of a stage whose inputs have these."""
        if made.params:
            keys = {**keys, "p": dataclasses.asdict(self.parameters(made))}
        text = json.dumps([made.name, made.version, keys], sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def parameters(self, made: Stage) -> Any:
        """The parameters of a stage: defaults, then what the experiment gives."""
        obj, problems = read(made.params, self.experiment.params.get(made.name, {}), f"[params.{made.name}]")  # type: ignore[arg-type]
        if problems:  # found already when the folder was read
            raise MissingKey(problems)
        return obj

    def _input(self, i: Input) -> tuple[object, object]:
        """(what identifies it, the argument)."""
        if i.type is Said:
            return (said := self.said()), said
        if i.type is Experiment:
            e = self.experiment
            return [e.name, e.header.group, e.ground], e
        if issubclass(i.type, Section):
            section = self.experiment.section(i.type)
            if section is None:
                return None, None
            values = dataclasses.asdict(section)
            path = values.pop("path", None)  # the same recording elsewhere is the same input
            return ([values, self._hashes.of_recording(path)] if path else values), section
        if self._lack(i.type):
            return None, None
        try:
            return self._make(i.type)
        except NotApplicable:
            if i.optional:
                return None, None
            raise

    def _compute(self, made: Stage, arguments: Mapping[str, object], key: str) -> tuple[Record, Receipt]:
        record, nothing_to_do = None, []  # a stage that finds nothing to do is remembered like a result
        # to look at more than 16 files before each part is kept would take long
        check = functools.partial(self._read_what_was_hashed, made, 16)
        parts = entries.Parts(self.cache, made.name, key, made.version, check=check, fresh=self.fresh)
        with setting(KEEPER, parts), warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", StageWarning)
            try:
                record = made.called_with(arguments)
            except NotApplicable as e:
                nothing_to_do = e.problems
            except MissingKey as e:
                raise MissingKey([f"{self.experiment.path / 'experiment.toml'}: {p}" for p in e.problems]) from None
            except Shared:
                self._keep_only_of_what_was_hashed(made, parts)
                raise
            except Exception as e:
                e.add_note(f"in stage '{made.name}' of {self.experiment.path}")
                raise
        # a picture reads the film that its stage has read: its warnings are known
        notes = [] if made.picture else warnings_in(caught)
        for w in caught:
            if not issubclass(w.category, StageWarning):
                warnings.warn_explicit(w.message, w.category, w.filename, w.lineno)
        self._keep_only_of_what_was_hashed(made, parts)
        receipt = entries.keep(
            self.cache,
            made.name,
            key,
            lambda folder: record.save(folder) if record is not None else None,
            version=made.version,
            warnings=notes,
            not_applicable=nothing_to_do,
            good=lambda: self._good(key, made.output),
        )
        parts.drop()
        if record is None:
            raise NotApplicable(nothing_to_do)
        return record, receipt

    def _load(self, key: str, output: type[Record]) -> tuple[Record, Receipt]:
        """The record and receipt of a whole, undamaged entry; NotApplicable where it says that there is none."""
        with entries.opened(self.cache, STAGES[output].name, key) as receipt:
            if self.fresh and receipt["versions"] != entries.versions():
                raise FileNotFoundError
            folder = entries.place(self.cache, receipt["stage"], key)
            record = None if receipt["not_applicable"] else output.load(folder)
        if record is None:
            raise NotApplicable(receipt["not_applicable"])
        return record, receipt

    def _good(self, key: str, output: type[Record]) -> bool:
        try:
            self._load(key, output)
        except NotApplicable:
            return True
        except (FileNotFoundError, CorruptEntry):
            return False
        return True

    def _publish(self, entry: Path, outputs: Mapping[str, str]) -> None:
        """The result files beside the others; replaced in one step where they differ."""
        self.results.mkdir(parents=True, exist_ok=True)
        for name, digest in outputs.items():
            target = self.results / name
            if not target.exists() or self._hashes.of_file(target) != digest:
                copy_aside(entry / name, target, digest)
            self._published[target] = stamp(target)

    # -- hashes ----------------------------------------------------------------------------------------------

    @property
    def recordings(self) -> Mapping[Path, Hashed]:
        """The recordings that were read, as sections name them: their files, each as it was hashed."""
        return self._hashes.read

    @property
    def inputs(self) -> dict[str, str]:
        """SHA-256 of what was read, by its name in provenance.json."""
        out: dict[str, str] = {}
        for files in self.recordings.values():
            before = self._relative(os.path.join(files.folder, "x"))[:-1]  # what stands before a name
            out.update((before + name, digest) for name, (_, digest, _) in zip(files.names, files))
        return out

    def counted(self) -> Iterator[tuple[Path, Stamp, str]]:
        """(file, stamp, SHA-256) of the results; of what they were kept as in the cache "" for it."""
        found = [(entries.place(self.cache, s.stage, s.key), s.files) for s in self.steps]
        # the first that raised it: those that read its record have no entry of their own
        nothing = {e: o for o, e in reversed(self._failed.items()) if isinstance(e, NotApplicable)}.values()
        found += [(entries.place(self.cache, STAGES[o].name, self.key(o)), {}) for o in nothing]
        for entry, outputs in found:
            yield from ((self.results / n, self._published[self.results / n], digest) for n, digest in outputs.items())
            yield from ((f, stamp(f), "") for f in (entry / entries.RECEIPT, *(entry / n for n in outputs)))

    def _relative(self, file: str) -> str:
        """A recording's name in provenance.json; whole where it lies on another drive."""
        try:
            return os.path.relpath(file, self.experiment.path).replace(os.sep, "/")
        except ValueError:
            return Path(file).as_posix()

    def _keep_only_of_what_was_hashed(self, made: Stage, parts: entries.Parts) -> None:
        try:
            self._read_what_was_hashed(made)
        except InputError:
            parts.drop()
            raise

    def _read_what_was_hashed(self, made: Stage, most: int = sys.maxsize) -> None:
        """What a stage has read is what its key says: a recording that was exchanged meanwhile is another one. most:
        files of a recording that are looked at, else none."""
        for i in made.inputs:
            section = self.experiment.section(i.type) if issubclass(i.type, Section) else None
            files = self.recordings.get(getattr(section, "path", None), NOTHING)  # type: ignore[arg-type]
            for f, digest, at in files if len(files) <= most else ():
                try:
                    same = stamp(f) == at or sha256(Path(f)) == digest
                except OSError:
                    same = False
                if not same:
                    raise InputError([f"{f}: changed while stage '{made.name}' read it; run again when it is whole"])
