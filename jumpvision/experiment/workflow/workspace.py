"""Stages run on an experiment, their results kept.

`Workspace.make(Track)` walks back from the wanted record, computes what is missing or changed and keeps each result
under the hash of its inputs, parameters and version (`entries`). A record is read only where it is asked for, or where
another is computed from it. A recording that changes while it is read is no input.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

from jumpvision.base.record import Record
from jumpvision.base.schema import InputError, WarningRecord, read, warnings_in
from jumpvision.base.storage import ChangedFile, Stamp, copy_aside, remove_aside, sha256, stamp
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import MissingKey, NotApplicable, Section

from . import entries
from .entries import ATTEMPTS, CorruptEntry, Receipt
from .stage import STAGES, Input, Said, Stage, StageWarning, results_stages
from .stamps import Stamps, text_of

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
        self._keys: dict[type, str] = {}  # of the records that are in the cache
        self._records: dict[type, Record] = {}  # those of them that were read
        self._failed: dict[type, Exception] = {}
        self._lacks: dict[type, str] = {}  # what `_lack` has found
        self._stamps = Stamps(self.cache, verify=verify)
        self._published: dict[Path, Stamp] = {}

    # -- what can be made ------------------------------------------------------------------------------------

    def missing(self, output: type) -> str:
        """Why `output` cannot be made from this experiment: "" or the sections it lacks, in words."""
        lack = self._lack(output)
        return f"{STAGES[output].name} needs {lack}" if lack else ""

    def _lack(self, kind: type) -> str:
        """The sections that are missing for a section or record to be there; "" when it can be had."""
        if kind not in self._lacks:
            self._lacks[kind] = self._found_lacking(kind)
        return self._lacks[kind]

    def _found_lacking(self, kind: type) -> str:
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
        for attempt in range(ATTEMPTS):
            key, name = self.complete(output), STAGES[output].name
            if output in self._records:
                break
            entry = entries.place(self.cache, name, key)
            try:
                with entries.opened(self.cache, name, key):
                    self._records[output] = output.load(entry)
            except (FileNotFoundError, CorruptEntry) as e:
                if attempt == ATTEMPTS - 1:
                    raise
                if isinstance(e, CorruptEntry):
                    warnings.warn(StageWarning("cache", f"{e}; computed again"), stacklevel=2)
                    remove_aside(entry, self.cache)
                del self._keys[output]
                self.steps = [s for s in self.steps if s.stage != name]
        return cast(R, self._records[output])

    def complete(self, output: type) -> str:
        """Return the key of a record, computed where the cache lacks it, its file put into the results folder."""
        if output in self._failed:
            raise self._failed[output]
        if output not in self._keys:
            try:
                self._keys[output] = self._complete(STAGES[output])
            except Exception as e:
                self._failed[output] = e
                raise
        return self._keys[output]

    @property
    def failed(self) -> set[type]:
        """Records that could not be made, or of which there are none."""
        return set(self._failed)

    def key(self, output: type) -> str:
        """The key that `output` has for the inputs and parameters as they are; nothing is computed.

        Raises MissingKey or InputError where it cannot be made.
        """
        if output in self._keys:
            return self._keys[output]
        if why := self.missing(output):
            raise MissingKey([why])
        return self._hashed(STAGES[output], self._key_unless_nothing)

    def _key_unless_nothing(self, output: type) -> str:
        if self._nothing_to_do(output):
            raise NotApplicable([])
        return self.key(output)

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
        except NotApplicable:
            return True
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
                self._stamps.save()
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

    def _complete(self, made: Stage) -> str:
        if why := self.missing(made.output):
            raise MissingKey([f"{self.experiment.path / 'experiment.toml'}: {why}"])
        key, began = self._hashed(made, self.complete), time.perf_counter()
        for attempt in range(ATTEMPTS):
            try:
                receipt, state = self._receipt(made, key), "cached"
            except (FileNotFoundError, CorruptEntry) as e:
                if self.computes == "nothing" or (self.computes == "pictures" and not made.picture):
                    raise NotCached(made.name) from None
                if isinstance(e, CorruptEntry):
                    warnings.warn(StageWarning("cache", f"{e}; computed again"), stacklevel=2)
                receipt, state = self._compute(made, key), "computed"
            if receipt["not_applicable"]:
                raise NotApplicable(receipt["not_applicable"])
            try:
                self._publish(entries.place(self.cache, made.name, key), receipt["outputs"])
                break
            except (FileNotFoundError, ChangedFile):  # the entry was pruned, or mended by another run, in between
                if attempt == ATTEMPTS - 1:
                    raise
        seconds, notes = time.perf_counter() - began, receipt["warnings"]
        self.steps.append(Step(made.name, state, seconds, notes, key, receipt["versions"], receipt["outputs"]))
        return key

    def _receipt(self, made: Stage, key: str) -> Receipt:
        """Return the receipt of a whole entry. Raises as `check_entry`; FileNotFoundError where it is made anew."""
        receipt = entries.check_entry(self.cache, made.name, key, self._stamps.of_file)
        if self.fresh and receipt["versions"] != entries.versions():
            raise FileNotFoundError
        return receipt

    def _hashed(self, made: Stage, key_of: Callable[[type], str]) -> str:
        """Return the key of a stage whose input records have the keys of `key_of`."""
        keys: dict[str, object] = {i.name: self._identity(i, key_of) for i in made.inputs}
        if made.params:
            keys["p"] = dataclasses.asdict(self.parameters(made))
        text = json.dumps([made.name, made.version, keys], sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def parameters(self, made: Stage) -> Any:
        """The parameters of a stage: defaults, then what the experiment gives."""
        obj, problems = read(made.params, self.experiment.params.get(made.name, {}), f"[params.{made.name}]")  # type: ignore[arg-type]
        if problems:  # found already when the folder was read
            raise MissingKey(problems)
        return obj

    def _identity(self, i: Input, key_of: Callable[[type], str]) -> object:
        """Return the value that identifies an input, None where it is missing."""
        if i.type is Said:
            return self.said()
        if i.type is Experiment:
            e = self.experiment
            return [e.name, e.header.group, e.ground]
        if issubclass(i.type, Section):
            section = self.experiment.section(i.type)
            if section is None:
                return None
            values = dataclasses.asdict(section)
            path = values.pop("path", None)  # the same recording elsewhere is the same input
            return [values, self._stamps.of_recording(path)] if path else values
        if self._lack(i.type):
            return None
        try:
            return key_of(i.type)
        except NotApplicable:
            if i.optional:
                return None
            raise

    def _argument(self, i: Input) -> object:
        """An input as its stage takes it."""
        if i.type is Said:
            return self.said()
        if i.type is Experiment:
            return self.experiment
        if issubclass(i.type, Section):
            return self.experiment.section(i.type)
        there = not self._lack(i.type) and not isinstance(self._failed.get(i.type), NotApplicable)
        return self.make(cast(type[Record], i.type)) if there else None

    def _compute(self, made: Stage, key: str) -> Receipt:
        arguments = {i.name: self._argument(i) for i in made.inputs}
        if made.params:
            arguments["p"] = self.parameters(made)
        record, nothing_to_do = None, []  # a stage that finds nothing to do is remembered like a result
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", StageWarning)
            try:
                record = made.called_with(arguments)
            except NotApplicable as e:
                nothing_to_do = e.problems
            except MissingKey as e:
                raise MissingKey([f"{self.experiment.path / 'experiment.toml'}: {p}" for p in e.problems]) from None
            except Exception as e:
                e.add_note(f"in stage '{made.name}' of {self.experiment.path}")
                raise
        # a picture reads the film that its stage has read: its warnings are known
        notes = [] if made.picture else warnings_in(caught)
        for w in caught:
            if not issubclass(w.category, StageWarning):
                warnings.warn_explicit(w.message, w.category, w.filename, w.lineno)
        self._read_what_was_hashed(made)
        receipt = entries.keep(
            self.cache,
            made.name,
            key,
            lambda folder: record.save(folder) if record is not None else None,
            version=made.version,
            warnings=notes,
            not_applicable=nothing_to_do,
            good=lambda: self._is_whole(made, key),
        )
        if record is not None:
            self._records[made.output] = record
        return receipt

    def _is_whole(self, made: Stage, key: str) -> bool:
        try:
            receipt = entries.check_entry(self.cache, made.name, key)
        except (FileNotFoundError, CorruptEntry):
            return False
        return not self.fresh or receipt["versions"] == entries.versions()

    def _publish(self, entry: Path, outputs: Mapping[str, str]) -> None:
        """The result files beside the others; replaced in one step where they differ."""
        self.results.mkdir(parents=True, exist_ok=True)
        for name, digest in outputs.items():
            target = self.results / name
            if not target.exists() or self._stamps.of_file(target) != digest:
                copy_aside(entry / name, target, digest)
            self._published[target] = stamp(target)

    # -- hashes ----------------------------------------------------------------------------------------------

    @property
    def inputs(self) -> dict[str, str]:
        """SHA-256 of what was read, by its name in provenance.json."""
        out: dict[str, str] = {}
        for files in self._stamps.recordings.values():
            before = self._relative(os.path.join(files.folder, "x"))[:-1]  # what stands before a name
            out.update((before + name, digest) for name, (_, digest, _) in zip(files.names, files))
        return out

    def _relative(self, file: str) -> str:
        """A recording's name in provenance.json; whole where it lies on another drive."""
        try:
            return os.path.relpath(file, self.experiment.path).replace(os.sep, "/")
        except ValueError:
            return Path(file).as_posix()

    def _read_what_was_hashed(self, made: Stage) -> None:
        """Check that a stage has read what its key names: a recording that was exchanged meanwhile is another one."""
        for i in made.inputs:
            section = self.experiment.section(i.type) if issubclass(i.type, Section) else None
            for f, digest, at in self._stamps.recordings.get(getattr(section, "path", Path()), ()):
                try:
                    same = text_of(stamp(f)) == at or sha256(Path(f)) == digest
                except OSError:
                    same = False
                if not same:
                    raise InputError([f"{f}: changed while stage '{made.name}' read it; run again when it is whole"])
