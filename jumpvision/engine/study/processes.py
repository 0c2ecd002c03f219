"""Where a user's simulator runs: in this process, or in others that may crash or hang, or alone may import it."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from jumpvision.base.progress import end_with_parent
from jumpvision.base.schema import InputError

from .inputs import applied
from .study import Recording, Study, may_have_slopes

START = 120.0  # s that a process may take to import a simulator
FORM = "--simulator {}: must be MODULE:NAME, as in pendulum:study or lab/pendulum.py:study"
Values = Mapping[str, float]
Given = object  # what a user's function gives, or a Failure; `Runs` checks it


@dataclass(frozen=True)
class Ask:
    """One run: which of the study's functions, which recording, with what. like: another whose inputs it is given;
    slopes: its derivatives are asked for; later: [s] by which all times are shifted."""

    function: int
    recording: int
    parameters: Values
    like: int | None = None
    slopes: bool = False
    later: float = 0.0

    def of(self, recordings: Sequence[Recording]) -> tuple[dict[str, float], Recording]:
        """What the simulator is called with."""
        r = recordings[self.recording]
        if self.like is not None:
            r = replace(r, inputs=recordings[self.like].inputs)
        return applied(self.parameters, replace(r, t=r.t + self.later) if self.later else r)


@dataclass(frozen=True)
class How:
    """How runs are made. workers: other processes (0: this one, which then cannot outlive a crash or a hang).

    limit: seconds that a run may take. budget: most runs. keep: file that keeps every run, from which a later call goes
    on; doubted: where one of its runs comes out otherwise now, the file begins anew. avoid: take a failed run for
    parameters that cannot be followed instead of stopping. progress: told of the count, in words, every second. source:
    MODULE:NAME of the study, imported by the other processes alone.
    """

    workers: int = 0
    limit: float | None = None
    budget: int | None = None
    keep: Path | None = None
    avoid: bool = False
    progress: Callable[[str], None] | None = None
    source: str = ""
    doubted: bool = False


@dataclass(frozen=True)
class Failure:
    """Why a run gave nothing."""

    why: str


class Maker(Protocol):
    def results(self, asked: Sequence[Ask]) -> Iterator[tuple[int, Given]]:
        """(place in the list, what the function gave or a Failure) as they come."""
        ...

    def close(self) -> None: ...


class Here:
    """Runs in this process."""

    def __init__(self, study: Study, recordings: Sequence[Recording]) -> None:
        self.study, self.recordings = study, recordings

    def results(self, asked: Sequence[Ask]) -> Iterator[tuple[int, Given]]:
        if not self.study.batch or any(a.slopes for a in asked):
            for k, a in enumerate(asked):
                yield k, _run(self.study, self.recordings, a)
            return
        for f in dict.fromkeys(a.function for a in asked):
            mine = [k for k, a in enumerate(asked) if a.function == f]
            yield from zip(mine, _batch(self.study, self.recordings, [asked[k] for k in mine]))

    def close(self) -> None:
        pass


def _run(study: Study, recordings: Sequence[Recording], ask: Ask) -> Given:
    """One run; what the function raises is a failure with its place."""
    try:
        if ask.slopes:
            if not may_have_slopes(study):
                return {}
            from .jacobian import derivatives

            return derivatives(study, *ask.of(recordings))
        return study.functions[ask.function](*study.arguments(*ask.of(recordings)))
    except Exception as e:  # a user's function may raise anything
        has = f"; the recording has the inputs {', '.join(recordings[ask.recording].inputs) or '(none)'}"
        return Failure(_raised(e) + (has if isinstance(e, KeyError) else ""))


def _batch(study: Study, recordings: Sequence[Recording], asked: Sequence[Ask]) -> list[Given]:
    """Runs of one function at once."""
    try:
        given = [a.of(recordings) for a in asked]
        out = list(study.functions[asked[0].function]([p for p, _ in given], [r for _, r in given]))
    except Exception as e:
        return [Failure(_raised(e))] * len(asked)
    if len(out) != len(asked):
        return [Failure(f"gave {len(out)} results for {len(asked)} runs (batch=True)")] * len(asked)
    return out


def _raised(e: Exception) -> str:
    """An exception in one line, with the line of the user's code that raised it."""
    place = traceback.extract_tb(e.__traceback__)[-1]
    return f"raised {type(e).__name__}: {e} (line {place.lineno} of {Path(place.filename).name})"


class Others:
    """Runs in other processes, which may die or hang; each then begins anew. A thread waits for each.

    pebble's pool does not serve: it waits for ever where a simulator exits with status 0 (Fortran's STOP), and for some
    that die as they begin (4 of 150).
    """

    def __init__(self, study: Study, recordings: Sequence[Recording], how: How, workers: int) -> None:
        self.given = (how.source or study, list(recordings))
        self.limit, self.context = how.limit, _context(study, how.source)
        self.processes: list[Process] = []
        try:
            for _ in range(workers):
                self.processes.append(Process(self.context, self.given))
        except BaseException:
            self.close()
            raise

    def results(self, asked: Sequence[Ask]) -> Iterator[tuple[int, Given]]:
        begun: dict[Future[Given], int] = {}
        threads, free = ThreadPoolExecutor(len(self.processes)), deque(range(len(self.processes)))
        try:
            for k, ask in enumerate(asked):
                begun[threads.submit(self._result, free, ask)] = k
            for future in as_completed(begun):
                yield begun[future], future.result()
        finally:  # what nobody waits for any more must not answer the next question
            threads.shutdown(wait=False, cancel_futures=True)
            while not all(f.done() for f in begun):
                for p in self.processes:
                    p.process.kill()
                    p.process.join(5.0)

    def _result(self, free: deque[int], ask: Ask) -> Given:
        i = free.pop()  # there are as many threads as processes
        try:
            if not self.processes[i].process.is_alive():
                self.processes[i].end()
                self.processes[i] = Process(self.context, self.given)
            return self.processes[i].answer(ask, self.limit)
        finally:
            free.append(i)

    def close(self) -> None:
        for p in self.processes:
            p.end()


class Process:
    """One other process."""

    def __init__(self, context: Any, given: tuple[Study | str, list[Recording]]) -> None:
        self.connection, child = context.Pipe()
        self.process = context.Process(target=_serve, args=(child, os.getcwd(), given), daemon=True)
        self.process.start()
        child.close()
        try:
            said = self.connection.recv() if self.connection.poll(START) else f"was not imported within {START:g} s"
        except EOFError:
            said = "cannot be imported in another process; see its message above"
        if said is not None:
            self.end()
            raise InputError([said if said.startswith("--simulator") else f"the simulator {said}"])

    def answer(self, ask: Ask | None, limit: float | None = None) -> Any:
        """Give the result of a run (None: the study without its functions); a Failure after `limit` [s], or where the
        process dies."""
        try:
            self.connection.send(ask)
            if self.connection.poll(limit):
                return self.connection.recv()
            self.end()
            return Failure(f"took longer than {limit:g} s (limit)")
        except (EOFError, ConnectionError):
            self.process.join(5.0)
            code = self.process.exitcode
            self.end()
            return Failure(f"died by signal {-code}" if code and code < 0 else f"died with exit status {code}")

    def end(self) -> None:
        self.connection.close()
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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who asks
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
            alone = asked.slopes or not study.batch
            result = _run(study, recordings, asked) if alone else _batch(study, recordings, [asked])[0]
            connection.send(result if isinstance(result, Failure) else _portable(result))
        else:
            connection.send(_description(study, recordings))


@dataclass(frozen=True)
class _Known:
    """First value of a parameter that every recording has for itself, by the recording's name."""

    values: Mapping[str, float]

    def __call__(self, recording: Recording) -> float:
        return self.values[recording.name]


def _description(study: Study, recordings: Sequence[Recording]) -> Study | Failure:
    """The study without its functions; its version tells their source."""
    try:
        given = [
            replace(p, start=_Known({r.name: float(p.start(r)) for r in recordings})) if callable(p.start) else p
            for p in study.parameters
        ]
    except Exception as e:
        return Failure(_raised(e))
    text = "".join(source_of(f) for f in study.functions)
    version = hashlib.sha256(f"{study.version} {text}".encode()).hexdigest()
    return replace(study.without_functions(), parameters=given, version=version)


def described(source: str, recordings: Sequence[Recording]) -> Study:
    """The study MODULE:NAME as another process tells of it: nothing of the user's is imported here."""
    process = Process(multiprocessing.get_context("spawn"), (source, list(recordings)))
    found = process.answer(None)
    process.end()
    return result_of_study(source, found)


def result_of_study(source: str, found: Any) -> Any:
    """Return the result of the study MODULE:NAME. Raises InputError where it is a Failure."""
    if isinstance(found, Failure):
        raise InputError([f"--simulator {source}: {found.why}"])
    return found


def _portable(value: Any) -> object:
    """What a simulator gave as plain arrays, which any process can read."""
    if hasattr(value, "columns"):
        return {str(c): np.asarray(value[c], float) for c in value.columns}
    try:
        return {k: np.asarray(v, float) for k, v in value.items()} if isinstance(value, Mapping) else np.asarray(value)
    except Exception as e:
        return Failure(_raised(e))


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
        said = f"{file} lies in the folder of recordings {folder}, from which nothing is imported; move it out"
        raise InputError([f"--simulator {source}: {said}"])


def source_of(function: Callable[..., object]) -> str:
    """The text of the module that holds a function, of the function alone where there is none; the version of what
    has one (`engine.simulators`)."""
    if isinstance(version := getattr(function, "version", None), str):
        return version
    try:
        return inspect.getsource(sys.modules[function.__module__])
    except (OSError, TypeError, KeyError):
        try:
            return inspect.getsource(function)
        except (OSError, TypeError):
            return f"{function.__module__}.{getattr(function, '__qualname__', repr(function))}"
