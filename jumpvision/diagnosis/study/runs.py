"""Runs of a user's simulator: each made once, in this process or in others, watched for crash, hang, NaN and shape."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import multiprocessing
import os
import pickle
import sqlite3
import sys
import threading
import time
import traceback
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.progress import end_with_parent
from jumpvision.base.schema import InputError

from .study import Recording, Study

HELD = 512 * 2**20  # bytes of results kept in memory
EVERY = 1.0  # s between two reports
START = 120.0  # s that a process may take to import a simulator
FORM = "--simulator {}: must be MODULE:NAME, as in pendulum:study or lab/pendulum.py:study"
Values = Mapping[str, float]


class SimulatorError(InputError):
    """A run that gave nothing to compare. parameters, recording: those that did it."""

    def __init__(self, why: str, parameters: Values, recording: str) -> None:
        at = ", ".join(f"{n} = {v:.10g}" for n, v in parameters.items())
        super().__init__([f"the simulator {why}; recording {recording!r}, parameters {{{at}}}"])
        self.why, self.parameters, self.recording = why, dict(parameters), recording

    def __reduce__(self) -> tuple[Any, ...]:
        return SimulatorError, (self.why, self.parameters, self.recording)


@dataclass(frozen=True)
class Ask:
    """One run: which of the study's functions, which recording, with what."""

    function: int
    recording: int
    parameters: Values


@dataclass
class Count:
    """How many runs were made, taken from those kept, and avoided as failures; the seconds that the made ones took."""

    made: int = 0
    kept: int = 0
    seconds: float = 0.0
    failures: list[SimulatorError] = field(default_factory=list)


@dataclass(frozen=True)
class How:
    """How runs are made. workers: other processes (0: this one, which then cannot outlive a crash or a hang).

    limit: seconds that a run may take. budget: most runs. keep: file that keeps every run, from which a later call goes
    on. avoid: take a failed run for parameters that cannot be followed instead of stopping. progress: told of the
    count, in words, every second. source: MODULE:NAME of the study, imported by the other processes alone.
    """

    workers: int = 0
    limit: float | None = None
    budget: int | None = None
    keep: Path | None = None
    avoid: bool = False
    progress: Callable[[str], None] | None = None
    source: str = ""


class Runs:
    """The runs of a study. `many` gives results (n, channels); NaN where a failure is to be avoided."""

    def __init__(self, study: Study, recordings: Sequence[Recording], how: How) -> None:
        self.study, self.recordings, self.how = study, list(recordings), how
        self.count, self.told = Count(), 0.0
        self.held: OrderedDict[bytes, Array] = OrderedDict()
        self.bytes = 0
        self.store = _Store(how.keep) if how.keep else None
        self.digests = [_digest_of(r, study) for r in self.recordings]
        workers = max(how.workers, 1 if how.limit or how.source else 0)
        self.maker: _Maker = _Others(study, self.recordings, how, workers) if workers else _Here(study, self.recordings)

    def close(self) -> None:
        """End the other processes, close the file."""
        self.maker.close()
        if self.store:
            self.store.close()

    def many(self, asked: Sequence[Ask]) -> list[Array]:
        """Results in the order asked. Raises SimulatorError, or InputError when the budget is used up."""
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
            raise InputError(
                [
                    f"the budget of {self.how.budget} runs is used up{kept}: raise it, leave out candidates, or give "
                    "closer first values and narrower ranges"
                ]
            )
        wanted = list(new.items())
        began = time.perf_counter()
        for k, value in self.maker.made([a for _, a in wanted]):
            key, ask = wanted[k]
            found[key] = self._checked(value, ask)
            self._keep(key, found[key])
            self.count.made += 1
            self.count.seconds += time.perf_counter() - began
            began = time.perf_counter()
            self._tell()
        return [found[k] for k in keys]

    def _checked(self, value: Any, ask: Ask) -> Array:
        """The result of a run as (n, channels). Raises SimulatorError for what is none."""
        recording = self.recordings[ask.recording]
        shape = (recording.t.size, len(self.study.channels))
        if isinstance(value, _Failure):
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
        if not self.how.avoid:
            if self.store:
                error.add_note(f"{self.count.made} runs are kept in {self.how.keep}: the next call goes on from there")
            raise error
        self.count.failures.append(error)
        return np.full(shape, np.nan)

    def _key(self, ask: Ask) -> bytes:
        text = repr([(n, f"{v:.12e}") for n, v in sorted(ask.parameters.items())])
        return hashlib.sha256(f"{self.digests[ask.recording]} {ask.function} {text}".encode()).digest()

    def _kept(self, key: bytes, ask: Ask) -> Array | None:
        if key in self.held:
            self.held.move_to_end(key)
            return self.held[key]
        if self.store and (data := self.store.get(key)) is not None:
            shape = (self.recordings[ask.recording].t.size, len(self.study.channels))
            array = np.frombuffer(data).reshape(shape)
            self._hold(key, array)
            return array
        return None

    def _keep(self, key: bytes, array: Array) -> None:
        self._hold(key, array)
        if self.store and np.all(np.isfinite(array)):
            self.store.put(key, array.tobytes())

    def _hold(self, key: bytes, array: Array) -> None:
        self.held[key] = array
        self.bytes += array.nbytes
        while self.bytes > HELD and len(self.held) > 1:
            self.bytes -= self.held.popitem(last=False)[1].nbytes

    def _tell(self) -> None:
        if self.how.progress and time.perf_counter() - self.told > EVERY:
            self.told, c = time.perf_counter(), self.count
            most = f" of at most {self.how.budget}" if self.how.budget else ""
            self.how.progress(f"simulations: {c.made}{most}, {c.seconds / c.made:.2g} s each")


@dataclass(frozen=True)
class _Failure:
    """Why a run gave nothing."""

    why: str


class _Maker(Protocol):
    def made(self, asked: Sequence[Ask]) -> Iterator[tuple[int, Any]]:
        """(place in the list, what the function gave or a _Failure) as they come."""
        ...

    def close(self) -> None: ...


class _Here:
    """Runs in this process."""

    def __init__(self, study: Study, recordings: Sequence[Recording]) -> None:
        self.study, self.recordings = study, recordings

    def made(self, asked: Sequence[Ask]) -> Iterator[tuple[int, Any]]:
        if not self.study.batch:
            for k, a in enumerate(asked):
                yield k, _run(self.study, self.recordings, a)
            return
        for f in dict.fromkeys(a.function for a in asked):
            mine = [k for k, a in enumerate(asked) if a.function == f]
            yield from zip(mine, _batch(self.study, self.recordings, [asked[k] for k in mine]))

    def close(self) -> None:
        pass


def _run(study: Study, recordings: Sequence[Recording], ask: Ask) -> Any:
    """One run; what the function raises is a failure with its place."""
    try:
        return study.functions[ask.function](dict(ask.parameters), recordings[ask.recording])
    except Exception as e:  # a user's function may raise anything
        return _Failure(_raised(e))


def _batch(study: Study, recordings: Sequence[Recording], asked: Sequence[Ask]) -> list[Any]:
    """Runs of one function at once."""
    try:
        given = [dict(a.parameters) for a in asked], [recordings[a.recording] for a in asked]
        out = list(study.functions[asked[0].function](*given))
    except Exception as e:
        return [_Failure(_raised(e))] * len(asked)
    if len(out) != len(asked):
        return [_Failure(f"gave {len(out)} results for {len(asked)} runs (batch=True)")] * len(asked)
    return out


def _raised(e: Exception) -> str:
    """An exception in one line, with the line of the user's code that raised it."""
    place = traceback.extract_tb(e.__traceback__)[-1]
    return f"raised {type(e).__name__}: {e} (line {place.lineno} of {Path(place.filename).name})"


class _Others:
    """Runs in other processes, which may die or hang; each then begins anew."""

    def __init__(self, study: Study, recordings: Sequence[Recording], how: How, workers: int) -> None:
        self.given = (how.source or study, list(recordings))
        self.limit, self.context = how.limit, _context(study, how.source)
        self.processes: list[_Process] = []
        try:
            self.processes = [_Process(self.context, self.given) for _ in range(workers)]
        except BaseException:
            self.close()
            raise

    def made(self, asked: Sequence[Ask]) -> Iterator[tuple[int, Any]]:
        waiting = deque(enumerate(asked))
        while waiting or any(p.busy for p in self.processes):
            for i, p in enumerate(self.processes):
                if p.dead:
                    self.processes[i] = p = _Process(self.context, self.given)
                if not p.busy and waiting:
                    p.begin(*waiting.popleft())
            yield from self._results()

    def _results(self) -> Iterator[tuple[int, Any]]:
        busy = {p.connection: p for p in self.processes if p.busy}
        left = None
        if self.limit is not None:
            left = max(0.0, min(p.began for p in busy.values()) + self.limit - time.perf_counter())
        for ready in wait(list(busy), left):
            p = busy[ready]
            k = p.at
            yield k, p.result()
        for p in busy.values():
            if p.busy and self.limit is not None and time.perf_counter() - p.began >= self.limit:
                k = p.at
                p.end()
                yield k, _Failure(f"took longer than {self.limit:g} s (limit)")

    def close(self) -> None:
        for p in self.processes:
            p.end()


class _Process:
    """One other process and what it is busy with."""

    def __init__(self, context: Any, given: tuple[Study | str, list[Recording]]) -> None:
        self.connection, child = context.Pipe()
        self.process = context.Process(target=_serve, args=(child, os.getcwd(), given), daemon=True)
        self.at, self.busy, self.dead, self.began = -1, False, False, 0.0
        self.process.start()
        child.close()
        try:
            said = self.connection.recv() if self.connection.poll(START) else f"was not imported within {START:g} s"
        except EOFError:
            said = "cannot be imported in another process; see its message above"
        if said is not None:
            self.end()
            raise InputError([said if said.startswith("--simulator") else f"the simulator {said}"])

    def begin(self, at: int, ask: Ask) -> None:
        self.connection.send(ask)
        self.at, self.busy, self.began = at, True, time.perf_counter()

    def result(self) -> Any:
        self.busy = False
        try:
            return self.connection.recv()
        except (EOFError, ConnectionError):
            self.process.join(5.0)
            code = self.process.exitcode
            self.end()
            died = f"by signal {-code}" if code is not None and code < 0 else f"with exit status {code}"
            return _Failure(f"died {died}")

    def end(self) -> None:
        self.busy, self.dead = False, True
        self.connection.close()
        if self.process.is_alive():
            self.process.kill()
        self.process.join(5.0)


def _context(study: Study, source: str) -> Any:
    """Processes that begin anew, or copies of this one where functions live only here (a notebook's cell)."""
    spawn = multiprocessing.get_context("spawn")
    if source:
        return spawn
    interactive = any(f.__module__ == "__main__" for f in study.functions) and not hasattr(
        sys.modules["__main__"], "__file__"
    )
    try:
        pickle.dumps(study)
    except (pickle.PicklingError, AttributeError, TypeError) as e:
        interactive, why = True, str(e)
    else:
        why = "its function lives in a notebook"
    if not interactive:
        return spawn
    if "fork" not in multiprocessing.get_all_start_methods():
        raise InputError(
            [f"workers or limit: the simulator cannot be sent to another process ({why}); put it in a module"]
        )
    return multiprocessing.get_context("fork")


def _serve(connection: Connection, folder: str, given: tuple[Study | str, list[Recording]]) -> None:
    """The other process: runs what it is asked for until nobody asks any more."""
    threading.Thread(target=end_with_parent, daemon=True).start()
    os.dup2(2, 1)  # what a simulator prints must not stand in the command's result
    source, recordings = given
    try:
        study = study_at(source, folder) if isinstance(source, str) else source
    except Exception as e:  # a user's module may raise anything
        connection.send(e.problems[0] if isinstance(e, InputError) else _raised(e))
        return
    connection.send(None)
    while True:
        try:
            asked = connection.recv()
        except EOFError:
            return
        if isinstance(asked, Ask):
            result = _batch(study, recordings, [asked])[0] if study.batch else _run(study, recordings, asked)
            connection.send(result if isinstance(result, _Failure) else _portable(result))
        else:
            connection.send(_description(study, recordings))


@dataclass(frozen=True)
class _Known:
    """First value of a parameter that every recording has for itself, by the recording's name."""

    values: Mapping[str, float]

    def __call__(self, recording: Recording) -> float:
        return self.values[recording.name]


def _description(study: Study, recordings: Sequence[Recording]) -> Study | _Failure:
    """The study without its functions; its version tells their source."""
    try:
        given = [
            replace(p, start=_Known({r.name: float(p.start(r)) for r in recordings})) if callable(p.start) else p
            for p in study.parameters
        ]
    except Exception as e:
        return _Failure(_raised(e))
    text = "".join(_source(f) for f in study.functions)
    version = hashlib.sha256(f"{study.version} {text}".encode()).hexdigest()
    return replace(study.without_functions(), parameters=given, version=version)


def described(source: str, recordings: Sequence[Recording]) -> Study:
    """The study MODULE:NAME as another process tells of it: nothing of the user's is imported here."""
    process = _Process(multiprocessing.get_context("spawn"), (source, list(recordings)))
    try:
        process.connection.send("describe")
        found = process.connection.recv()
    except EOFError:
        found = _Failure("died when it was asked for its parameters")
    finally:
        process.end()
    if isinstance(found, _Failure):
        raise InputError([f"--simulator {source}: {found.why}"])
    return found


def _portable(value: Any) -> Any:
    """What a simulator gave as plain arrays, which any process can read."""
    if hasattr(value, "columns"):
        return {str(c): np.asarray(value[c], float) for c in value.columns}
    try:
        return {k: np.asarray(v, float) for k, v in value.items()} if isinstance(value, Mapping) else np.asarray(value)
    except Exception as e:
        return _Failure(_raised(e))


def study_at(source: str, folder: str) -> Study:
    """The Study called NAME in MODULE (a name that Python can import from `folder`, or a file), imported here."""
    module, _, name = source.rpartition(":")
    if not module or not name:
        raise InputError([FORM.format(source)])
    if module.endswith(".py"):
        path = Path(folder, module)
        if not path.exists():
            raise InputError([f"--simulator {source}: no file {path}"])
        folder, module = str(path.parent), path.stem
    sys.path.insert(0, folder)
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as e:
        raise InputError([f"--simulator {source}: {e}"]) from None
    if not isinstance(found, Study):
        raise InputError([f"--simulator {source}: is a {type(found).__name__}, not a jumpvision Study"])
    return found


def outside(source: str, folder: Path) -> None:
    """Raises InputError where the file of MODULE:NAME lies in a folder of recordings, which must hold no code."""
    module, _, name = source.rpartition(":")
    if not module or not name:
        raise InputError([FORM.format(source)])
    file = Path(module) if module.endswith(".py") else Path(*module.split(".")).with_suffix(".py")
    inside = Path.cwd() == folder.resolve() or folder.resolve() in file.resolve().parents
    if inside and (file.exists() or file.with_suffix("").is_dir()):
        raise InputError(
            [
                f"--simulator {source}: {file} lies in the folder of recordings {folder}, from which nothing is "
                "imported; move it out"
            ]
        )


def _digest_of(recording: Recording, study: Study) -> str:
    """Of all that a run depends on besides its parameters: the functions' source, the recording's times and inputs."""
    digest = hashlib.sha256(f"{study.name} {study.version} {[c.name for c in study.channels]}".encode())
    for f in study.functions:
        digest.update(_source(f).encode())
    digest.update(recording.t.tobytes() + recording.name.encode())
    for name, value in sorted(recording.inputs.items()):
        digest.update(name.encode() + (value.tobytes() if hasattr(value, "tobytes") else repr(value).encode()))
    digest.update(repr(sorted(recording.labels.items(), key=str)).encode())
    return digest.hexdigest()


def _source(function: Callable[..., Any]) -> str:
    """The text of the module that holds a function, of the function alone where there is none."""
    try:
        return inspect.getsource(sys.modules[function.__module__])
    except (OSError, TypeError, KeyError):
        try:
            return inspect.getsource(function)
        except (OSError, TypeError):
            return f"{function.__module__}.{getattr(function, '__qualname__', repr(function))}"


class _Store:
    """A file of runs by key; whole after every one of them."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self.file = sqlite3.connect(path)
            self.file.execute("CREATE TABLE IF NOT EXISTS runs (key BLOB PRIMARY KEY, value BLOB)")
        except sqlite3.DatabaseError as e:
            raise InputError([f"keep = {path}: {e}; name another file"]) from None

    def get(self, key: bytes) -> bytes | None:
        row = self.file.execute("SELECT value FROM runs WHERE key = ?", (key,)).fetchone()
        return None if row is None else bytes(row[0])

    def put(self, key: bytes, value: bytes) -> None:
        with self.file:
            self.file.execute("INSERT OR REPLACE INTO runs VALUES (?, ?)", (key, value))

    def close(self) -> None:
        self.file.close()
