"""Stages run on an experiment, their results kept.

`Workspace.make(Track)` walks back from the wanted record, computes what is missing or changed and keeps each result
under the hash of its inputs, parameters and version. An entry is written aside and renamed, so a killed run leaves
either a whole entry or none; checksums are verified when an entry is read.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import shutil
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

from jumpvision.base.schema import read
from jumpvision.base.storage import (
    aside_folder,
    companions,
    copy_aside,
    remove_aside,
    sealed,
    sha256,
    sync,
    unsealed,
    write_aside,
)
from jumpvision.inputs.experiment import Experiment
from jumpvision.inputs.sections import MissingKey, NotApplicable, Section

from .stage import STAGES, Input, Stage, StageWarning


class Receipt(TypedDict):
    """What lies beside the files of a cache entry: who made it, of what, and what there was to say."""

    stage: str
    version: int
    key: str
    warnings: list[str]
    not_applicable: list[str]  # why there is no record; empty where there is one
    outputs: dict[str, str]  # file: SHA-256


ATTEMPTS = 3  # at an entry that vanishes before its files are copied


@dataclass
class Step:
    """What became of one stage in a run."""

    stage: str
    state: str  # "computed" | "cached"
    seconds: float
    warnings: list[str]
    key: str


class NotCached(Exception):
    """A stage would have to be computed where only what is there already was asked for."""


class CorruptEntry(Exception):
    """A cached file does not have the checksum of its receipt."""


class Workspace:
    """Results and cache of one experiment.

    results: folder of the result files. cache: folder shared by the experiments of a campaign.
    verify: hash every input again instead of trusting an unchanged size and modification time.
    only_cached: raise NotCached instead of computing a stage.
    """

    def __init__(
        self, experiment: Experiment, results: Path, cache: Path, *, verify: bool = False, only_cached: bool = False
    ):
        self.experiment, self.results, self.cache, self.verify = experiment, Path(results), Path(cache), verify
        self.only_cached = only_cached
        self.steps: list[Step] = []
        self.inputs: dict[str, str] = {}  # relative path -> SHA-256
        self.outputs: set[str] = set()  # names of the result files made
        self._made: dict[type, tuple[str, Any]] = {}
        self._failed: dict[type, Exception] = {}

    # -- what can be made ------------------------------------------------------------------------------------

    def missing(self, output: type) -> str:
        """Why `output` cannot be made from this experiment: "" or the sections it lacks, in words."""
        lack = self._lack(output)
        return f"{STAGES[output].name} needs {lack}" if lack else ""

    def _lack(self, kind: type) -> str:
        """The sections that are missing for a section or record to be there; "" when it can be had."""
        if issubclass(kind, Section):
            return "" if self.experiment.section(kind) is not None else f"[{kind.name}]"
        if kind is Experiment:
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

    def make(self, output: type) -> Any:
        """The record, from the cache or computed, and its file in the results folder."""
        return self._make(output)[1]

    @property
    def made(self) -> dict[type, Any]:
        """The records made so far, by type."""
        return {output: record for output, (_, record) in self._made.items()}

    def withdraw(self, output: type) -> None:
        """Remove the result file of an earlier run, which is no result of the inputs as they are now."""
        (self.results / output.file).unlink(missing_ok=True)  # type: ignore[attr-defined]

    def _make(self, output: type) -> tuple[str, Any]:
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

    def _resolve(self, output: type) -> tuple[str, Any]:
        made = STAGES[output]
        why = self.missing(output)
        if why:
            raise MissingKey([f"{self.experiment.path / 'experiment.toml'}: {why}"])
        keys: dict[str, Any] = {}
        arguments: dict[str, Any] = {}
        for i in made.inputs:
            keys[i.name], arguments[i.name] = self._input(i)
        if made.params:
            arguments["p"] = self.parameters(made)
            keys["p"] = dataclasses.asdict(arguments["p"])
        text = json.dumps([made.name, made.version, keys], sort_keys=True, default=str)
        key = hashlib.sha256(text.encode()).hexdigest()
        entry = self.cache / made.name / key[:24]
        began = time.perf_counter()
        for attempt in range(ATTEMPTS):
            try:
                record, receipt = self._load(entry, output)
                state = "cached"
            except (FileNotFoundError, CorruptEntry) as e:
                if self.only_cached:
                    raise NotCached(made.name) from None
                if isinstance(e, CorruptEntry):
                    warnings.warn(f"{e}; computed again", StageWarning, stacklevel=2)
                record, receipt = self._compute(made, arguments, entry, key)
                state = "computed"
            try:
                self._publish(entry, receipt)
                break
            except FileNotFoundError:  # the entry was pruned, or mended by another run, in between
                if entry.exists() or attempt == ATTEMPTS - 1:
                    raise
        self.steps.append(Step(made.name, state, time.perf_counter() - began, receipt["warnings"], key))
        return key, record

    def parameters(self, made: Stage) -> Any:
        """The parameters of a stage: defaults, then what the experiment gives."""
        obj, problems = read(made.params, self.experiment.params.get(made.name, {}), f"[params.{made.name}]")  # type: ignore[arg-type]
        if problems:  # found already when the folder was read
            raise MissingKey(problems)
        return obj

    def _input(self, i: Input) -> tuple[Any, Any]:
        """(what identifies it, the argument)."""
        if i.type is Experiment:
            e = self.experiment
            return [e.name, e.header.group, e.ground], e
        if issubclass(i.type, Section):
            section = self.experiment.section(i.type)
            if section is None:
                return None, None
            values = dataclasses.asdict(section)
            path = values.pop("path", None)  # the same recording elsewhere is the same input
            return ([values, self._hash(path)] if path else values), section
        if self._lack(i.type):
            return None, None
        try:
            return self._make(i.type)
        except NotApplicable:
            if i.optional:
                return None, None
            raise

    def _compute(self, made: Stage, arguments: Mapping[str, Any], entry: Path, key: str) -> tuple[Any, Receipt]:
        record, nothing_to_do = None, []  # a stage that finds nothing to do is remembered like a result
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", StageWarning)
            try:
                record = made.made_of(arguments)
            except NotApplicable as e:
                nothing_to_do = e.problems
            except MissingKey as e:
                raise MissingKey([f"{self.experiment.path / 'experiment.toml'}: {p}" for p in e.problems]) from None
            except Exception as e:
                e.add_note(f"in stage '{made.name}' of {self.experiment.path}")
                raise
        # a picture reads the film that its stage has read: its warnings are known
        notes = [str(w.message) for w in caught if issubclass(w.category, StageWarning) and not made.picture]
        for w in caught:
            if not issubclass(w.category, StageWarning):
                warnings.warn_explicit(w.message, w.category, w.filename, w.lineno)
        aside = aside_folder(self.cache)
        try:
            if record is not None:
                record.save(aside)
            receipt: Receipt = {
                "stage": made.name,
                "version": made.version,
                "key": key,
                "warnings": notes,
                "not_applicable": nothing_to_do,
                "outputs": {f.name: sha256(f) for f in sorted(aside.iterdir())},
            }
            (aside / "receipt.json").write_text(sealed(receipt), encoding="utf-8")
            sync(aside)
            entry.parent.mkdir(parents=True, exist_ok=True)
            for attempt in range(ATTEMPTS):
                try:
                    os.rename(aside, entry)
                    break
                except OSError:  # there already: made by a faster run, or damaged
                    if self._whole(entry, made.output):
                        break
                    if attempt == ATTEMPTS - 1 or not entry.exists():
                        raise
                    remove_aside(entry, self.cache)
        finally:
            shutil.rmtree(aside, ignore_errors=True)
        if nothing_to_do:
            raise NotApplicable(nothing_to_do)
        return record, receipt

    def _load(self, entry: Path, output: type) -> tuple[Any, Receipt]:
        """The record and receipt of a whole, undamaged entry; NotApplicable where it says that there is none."""
        try:
            receipt: Receipt = unsealed((entry / "receipt.json").read_text(encoding="utf-8"))
            for name, digest in receipt["outputs"].items():
                if sha256(entry / name) != digest:
                    raise CorruptEntry(f"{entry / name}: damaged in the cache")
            with contextlib.suppress(OSError):  # when it was last used, for pruning by age
                os.utime(entry / "receipt.json")
            if receipt["not_applicable"]:
                raise NotApplicable(receipt["not_applicable"])
            return output.load(entry), receipt  # type: ignore[attr-defined]
        except (FileNotFoundError, NotApplicable):
            raise
        except (ValueError, KeyError, OSError) as e:
            raise CorruptEntry(f"{entry}: unreadable in the cache ({type(e).__name__})") from e

    def _whole(self, entry: Path, output: type) -> bool:
        try:
            self._load(entry, output)
        except NotApplicable:
            return True
        except (FileNotFoundError, CorruptEntry):
            return False
        return True

    def _publish(self, entry: Path, receipt: Receipt) -> None:
        """The result file beside the others; replaced in one step when it differs."""
        self.results.mkdir(parents=True, exist_ok=True)
        for name, digest in receipt["outputs"].items():
            target = self.results / name
            self.outputs.add(name)
            if not target.exists() or self._hash_file(target) != digest:
                copy_aside(entry / name, target)

    # -- hashes ----------------------------------------------------------------------------------------------

    def _hash(self, path: Path) -> str:
        """SHA-256 of a recording: of a file, or of all files of a folder or pattern with their names."""
        if path.is_file():
            files = companions(path)
        elif path.is_dir():
            files = sorted(f for f in path.iterdir() if f.is_file())
        else:
            files = sorted(path.parent.glob(path.name))
        digests = {}
        for f in files:
            digests[f.name] = self._hash_file(f)
            self.inputs[os.path.relpath(f, self.experiment.path).replace(os.sep, "/")] = digests[f.name]
        return hashlib.sha256(json.dumps(digests, sort_keys=True).encode()).hexdigest()

    def _hash_file(self, path: Path) -> str:
        """SHA-256 of a file, remembered while its size and modification time stay."""
        s = path.stat()
        memo = self.cache / "hashes" / (hashlib.sha256(str(path.absolute()).encode()).hexdigest()[:24] + ".json")
        # the time of the last change of any kind tells also an edit that keeps size and date, or a clock set back
        stamp = [s.st_size, s.st_mtime_ns, s.st_ctime_ns]
        if not self.verify:
            try:
                known = unsealed(memo.read_text(encoding="utf-8"))
                if known["stamp"] == stamp:
                    return str(known["sha256"])
            except (OSError, ValueError, KeyError):
                pass
        digest = sha256(path)
        write_aside(memo, sealed({"stamp": stamp, "sha256": digest}))
        return digest
