"""Runs of a user's simulator: each made once, kept, and watched for failure, NaN and shape."""

from __future__ import annotations

import hashlib
import sqlite3
import time
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.estimate.readings import readings

from .processes import Ask, Failure, Here, How, Maker, Others, Values, source_of
from .study import Recording, Study

BETWEEN = 1.0  # s between two reports of progress


class SimulatorError(InputError):
    """A run that gave nothing to compare. parameters, recording: those that did it."""

    def __init__(self, why: str, parameters: Values, recording: str) -> None:
        at = ", ".join(f"{n} = {v:.10g}" for n, v in parameters.items())
        super().__init__([f"the simulator {why}; recording {recording!r}, parameters {{{at}}}"])
        self.why, self.parameters, self.recording = why, dict(parameters), recording

    def __reduce__(self) -> tuple[object, ...]:
        return SimulatorError, (self.why, self.parameters, self.recording)


@dataclass
class Count:
    """How many runs were made, taken from those kept, and avoided as failures; the seconds that the made ones took."""

    made: int = 0
    kept: int = 0
    seconds: float = 0.0
    failures: list[SimulatorError] = field(default_factory=list)


class BudgetUsed(InputError):
    """No more runs may be made."""


class Runs:
    """The runs of a study. `many` gives results (n, channels); NaN where a failure is to be avoided.

    turned: channels whose turns are undone, in the recordings and here.
    """

    def __init__(
        self, study: Study, recordings: Sequence[Recording], how: How, turned: frozenset[int] = frozenset()
    ) -> None:
        self.study, self.recordings, self.how, self.turned = study, list(recordings), how, turned
        self.count, self.reported, self.total = Count(), 0.0, 0
        self.doubted = how.doubted
        self.held: OrderedDict[bytes, Array] = OrderedDict()
        self.bytes = 0
        self.store = _Store(how.keep) if how.keep else None
        self.digests = [_digest_of(r, study) for r in self.recordings]
        workers = max(how.workers, 1 if how.limit or how.source else 0)
        self.maker: Maker = Others(study, self.recordings, how, workers) if workers else Here(study, self.recordings)

    def foresee(self, share: float) -> None:
        """That so much of all runs is made, from which the rest is foretold."""
        self.total = round(self.count.made / share)

    def close(self) -> None:
        """End the other processes, close the file."""
        self.maker.close()
        if self.store:
            self.store.close()

    def many(self, asked: Sequence[Ask]) -> list[Array]:
        """Results in the order asked. Raises SimulatorError, or BudgetUsed."""
        keys = [self._key(a) for a in asked]
        found: dict[bytes, Array] = {}
        new: dict[bytes, Ask] = {}
        for key, ask in zip(keys, asked):
            if key in found or key in new:
                continue
            if (old := self._kept(key, ask)) is not None:
                found[key] = old
                self.count.kept += 1
            else:
                new[key] = ask
        if self.how.budget is not None and self.count.made + len(new) > self.how.budget:
            kept = f"; {self.how.keep} keeps them" if self.store else ""
            do = "raise it, leave out candidates, or give closer first values and narrower ranges"
            raise BudgetUsed([f"the budget of {self.how.budget} runs is used up{kept}: {do}"])
        wanted = list(new.items())
        began = time.perf_counter()
        for k, value in self.maker.results([a for _, a in wanted]):
            key, ask = wanted[k]
            found[key] = self._checked(value, ask)
            self._keep(key, found[key])
            self.count.made += 1
            self.count.seconds += time.perf_counter() - began
            began = time.perf_counter()
            self._tell()
        return [self._unwrapped(found[k]) for k in keys]

    def _unwrapped(self, array: Array) -> Array:
        if self.turned:
            array = array.copy()
            for k in self.turned:
                array[:, k] = readings(array[:, k]).values
        return array

    def slopes(self, asked: Sequence[Ask]) -> list[Mapping[str, Array]]:
        """The function's own derivatives (n, channels), finite ones, by parameter; {} where it has none. Raises
        SimulatorError where it fails, BudgetUsed."""
        if self.how.budget is not None and self.count.made + len(asked) > self.how.budget:
            raise BudgetUsed([f"the budget of {self.how.budget} runs is used up by derivatives: raise it"])
        out: list[Mapping[str, Array]] = [{}] * len(asked)
        for k, value in self.maker.results([replace(a, slopes=True) for a in asked]):
            if isinstance(value, Failure):
                name = self.recordings[asked[k].recording].name
                raise SimulatorError(f"by its derivatives {value.why}", asked[k].parameters, name)
            assert isinstance(value, Mapping)
            out[k] = {n: y for n, y in value.items() if np.all(np.isfinite(y))}
            self.count.made += bool(value)
        return out

    def _checked(self, value: Any, ask: Ask) -> Array:
        """The result of a run as (n, channels). Raises SimulatorError for what is none."""
        recording = self.recordings[ask.recording]
        shape = (recording.t.size, len(self.study.channels))
        if isinstance(value, Failure):
            return self._failed(SimulatorError(value.why, ask.parameters, recording.name), shape)
        try:
            array = recording.of_channels(value, self.study.channels, "simulated values")
        except (InputError, TypeError, ValueError) as e:
            problem = e.problems[0] if isinstance(e, InputError) else str(e)
            raise SimulatorError(f"gave what cannot be compared ({problem})", ask.parameters, recording.name) from None
        if not np.all(np.isfinite(array)):
            where = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
            why = f"gave NaN or infinity, first at t = {recording.t[where]:g} s"
            return self._failed(SimulatorError(why, ask.parameters, recording.name), shape)
        return array

    def _failed(self, error: SimulatorError, shape: tuple[int, int]) -> Array:
        if self.study.has_form(error.parameters):  # a law of ours that is none: nothing of the user's failed
            return np.full(shape, np.nan)
        if not self.how.avoid:
            if self.store:
                error.add_note(f"{self.count.made} runs are kept in {self.how.keep}: the next call goes on from there")
            raise error
        self.count.failures.append(error)
        return np.full(shape, np.nan)

    def _key(self, ask: Ask) -> bytes:
        text = repr([(n, f"{v:.12e}") for n, v in sorted(ask.parameters.items())])
        other = ("" if ask.like is None else self.digests[ask.like]) + (f" {ask.later!r} s" if ask.later else "")
        return hashlib.sha256(f"{self.digests[ask.recording]} {ask.function} {text}{other}".encode()).digest()

    def _kept(self, key: bytes, ask: Ask) -> Array | None:
        if key in self.held:
            self.held.move_to_end(key)
            return self.held[key]
        if self.store and (data := self.store.get(key)) is not None:
            shape = (self.recordings[ask.recording].t.size, len(self.study.channels))
            array = np.frombuffer(data).reshape(shape)
            if self.doubted and not self._same(ask, array):
                return None
            self._hold(key, array)
            return array
        return None

    def _same(self, ask: Ask, array: Array) -> bool:
        """Whether a run that is kept comes out as it did; if not, none of them serves any more."""
        assert self.store
        self.doubted = False
        self.count.made += 1
        _, value = next(iter(self.maker.results([ask])))
        if np.allclose(self._checked(value, ask), array, rtol=1e-9, atol=1e-12 * float(np.max(np.abs(array)))):
            return True
        self.store.clear()
        return False

    def _keep(self, key: bytes, array: Array) -> None:
        self._hold(key, array)
        if self.store and np.all(np.isfinite(array)):
            self.store.put(key, array.tobytes())

    def _hold(self, key: bytes, array: Array) -> None:
        self.held[key] = array
        self.bytes += array.nbytes
        while self.bytes > 512 * 2**20 and len(self.held) > 1:  # bytes of results kept in memory
            self.bytes -= self.held.popitem(last=False)[1].nbytes

    def _tell(self) -> None:
        if self.how.progress and time.perf_counter() - self.reported > BETWEEN:
            self.reported, c = time.perf_counter(), self.count
            most = f" of at most {self.how.budget}" if self.how.budget else ""
            each, left = c.seconds / max(c.made, 1), ""
            if self.total > c.made:
                most = most or f" of about {self.total}"
                left = f", about {(self.total - c.made) * each:.2g} s left"
            self.how.progress(f"simulations: {c.made}{most}, {each:.2g} s each{left}")


def _digest_of(recording: Recording, study: Study) -> str:
    """Of all that a run depends on besides its parameters: the functions' source, the recording's times and inputs."""
    laws = [(m.name, m.law, m.null) for m in (*study.mechanisms, *(m for _, m in study.forms)) if m.law]
    digest = hashlib.sha256(f"{study.name} {study.version} {[c.name for c in study.channels]} {laws or ''}".encode())
    for f in study.functions:
        digest.update(source_of(f).encode())
    digest.update(recording.t.tobytes() + recording.name.encode())
    for name, value in sorted(recording.inputs.items()):
        digest.update(name.encode() + (value.tobytes() if hasattr(value, "tobytes") else repr(value).encode()))
    digest.update(repr(sorted(recording.labels.items(), key=str)).encode())
    return digest.hexdigest()


class _Store:
    """A file of runs by key; whole after every one of them."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self.file = sqlite3.connect(path)
            self.file.execute("PRAGMA synchronous = OFF")  # a loss of power may cost runs, which are made again
            self.file.execute("CREATE TABLE IF NOT EXISTS runs (key BLOB PRIMARY KEY, value BLOB)")
        except sqlite3.DatabaseError as e:
            raise InputError([f"keep = {path}: {e}; name another file"]) from None

    def get(self, key: bytes) -> bytes | None:
        row = self.file.execute("SELECT value FROM runs WHERE key = ?", (key,)).fetchone()
        return None if row is None else bytes(row[0])

    def put(self, key: bytes, value: bytes) -> None:
        with self.file:
            self.file.execute("INSERT OR REPLACE INTO runs VALUES (?, ?)", (key, value))

    def clear(self) -> None:
        with self.file:
            self.file.execute("DELETE FROM runs")

    def close(self) -> None:
        self.file.close()
