"""Any program that reads and writes CSV, as the function of a study."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, closest
from jumpvision.engine.study.study import Recording

FILES = ("{parameters}", "{inputs}", "{output}")


@dataclass(frozen=True)
class Program:
    """`simulate` of a study, see `from_program`; it can be sent to other processes."""

    command: tuple[str, ...]
    channels: tuple[str, ...]
    time: str

    @property
    def version(self) -> str:
        """Its command, and the program's file where the first word is one."""
        file = Path(self.command[0])
        stamp = file.stat().st_mtime_ns if file.is_file() else 0
        return repr((self.command, self.channels, self.time, stamp))

    def __call__(self, p: Mapping[str, float], r: Recording) -> dict[str, Array]:
        import pandas as pd

        with tempfile.TemporaryDirectory() as folder:
            files = {f: Path(folder) / f"{f.strip('{}')}.csv" for f in FILES}
            inputs: dict[str, Any] = dict(r.inputs)
            numbers = dict(p) | {n: v for n, v in inputs.items() if np.ndim(v) == 0 and not isinstance(v, str)}
            series = {n: v for n, v in inputs.items() if np.shape(v) == r.t.shape}
            pd.DataFrame({"name": [*numbers], "value": [*numbers.values()]}).to_csv(files["{parameters}"], index=False)
            pd.DataFrame({self.time: r.t, **series}).to_csv(files["{inputs}"], index=False)
            command = [_filled(word, files) for word in self.command]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                said = (done.stderr or done.stdout).strip().splitlines()[-1:]
                raise RuntimeError(f"{command[0]} ended with {done.returncode}: {''.join(said) or 'it said nothing'}")
            if not files["{output}"].exists():
                raise RuntimeError(f"{command[0]} wrote no {{output}}")
            table = pd.read_csv(files["{output}"], dtype=str)  # Python's own float is exact
        for name in (self.time, *self.channels):
            if name not in table:
                raise RuntimeError(f"{{output}} has no column {name!r}{closest(name, list(table))}")
        t = table[self.time].to_numpy(float)
        if not np.all(np.diff(t) > 0) or t[0] > r.t[0] or t[-1] < r.t[-1]:
            raise RuntimeError(
                f"{{output}}: {self.time} must increase and reach from {r.t[0]:g} to {r.t[-1]:g} s; it holds "
                f"{t.size} rows from {t[0]:g} to {t[-1]:g}"
            )
        return {c: np.interp(r.t, t, table[c].to_numpy(float)) for c in self.channels}


def from_program(command: Sequence[str], channels: Sequence[str], *, time: str = "time_s") -> Program:
    """Any program as the `simulate` of a Study: it is started once a run, reads two CSV files and writes a third.

    command: its words; {parameters}, {inputs} and {output} stand for the files. {parameters}: columns name, value: of
    every parameter of the study, and of inputs of the recording that are one number. {inputs}: the column `time`, and
    inputs that have one number a time. {output}, which it writes: `time` and a column a channel; between its rows
    values are straight lines. A program that fails, or writes other columns or times, is an error with its last line.

    Example: jv.from_program(["./hopper", "{parameters}", "{inputs}", "{output}"], ["height"])
    """
    if not any("{output}" in word for word in command):
        raise InputError([f"from_program: command = {[*command]}: no word holds {{output}}, the file to be written"])
    return Program(tuple(command), tuple(channels), time)


def _filled(word: str, files: Mapping[str, Path]) -> str:
    for name, file in files.items():
        word = word.replace(name, str(file))
    return word
