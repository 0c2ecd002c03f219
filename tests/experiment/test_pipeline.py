"""The pipeline: nothing recomputed without need, nothing half-written taken for whole."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from jumpvision.base import storage
from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.parameters import FitParams
from jumpvision.experiment.inputs.sections import Actuation, MissingKey, MotorLog, need
from jumpvision.experiment.results.values import Values
from jumpvision.experiment.workflow import stage as stage_module
from jumpvision.experiment.workflow import workspace as pipeline
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.films.parameters import BedParams

CALLS: list[str] = []
MEANWHILE: list = []  # what happens while the first stage reads its log


class First(Values):
    file = "first.json"


class Second(Values):
    file = "second.json"


class Third(Values):
    file = "third.json"


@pytest.fixture(autouse=True)
def toy_stages(monkeypatch):
    """Three stages of our own: first (log, fit parameters) -> second -> third (also bed parameters)."""
    stages = {}
    for module in (stage_module, pipeline):
        monkeypatch.setattr(module, "STAGES", stages)
    CALLS.clear()
    MEANWHILE.clear()

    def fit(log: MotorLog, *, p: FitParams) -> First:
        CALLS.append("first")
        for act in MEANWHILE:
            act()
        if p.debounce == 0.05:
            warnings.warn(StageWarning("noise", "long debounce"), stacklevel=2)
        return First({"rows": len(log.path.read_text().splitlines()), "debounce": p.debounce})

    def second(first: First, law: Actuation | None) -> Second:
        CALLS.append("second")
        return Second({"twice": 2 * first.values["rows"], "f": law.frequency if law else None})

    def bed(second: Second, *, p: BedParams) -> Third:
        CALLS.append("third")
        if second.values["f"] == 666.0:
            raise ValueError("no such frequency")
        need(Actuation(), *(["frequency"] if second.values["f"] == 13.0 else []))
        return Third({"sum": 1 + second.values["twice"], "method": p.method})

    for f in (fit, second, bed):
        f.__annotations__ = {k: eval(v) if isinstance(v, str) else v for k, v in f.__annotations__.items()}
        stage(version=1)(f)


@dataclass
class Lab:
    root: object

    def write(self, log="time_s,position_m\n0,0\n", toml="[motor_log]\nfile = 'motor.csv'\n"):
        folder = self.root / "exp"
        folder.mkdir(exist_ok=True)
        (folder / "experiment.toml").write_text(toml)
        (folder / "motor.csv").write_text(log)

    def make(self, output=Third, *, where="exp", **overrides):
        CALLS.clear()
        experiment = open_experiment(self.root / where, overrides=overrides)
        w = Workspace(experiment, self.root / "results", self.root / "cache")
        return w.make(output).values, list(CALLS), w


@pytest.fixture
def lab(tmp_path):
    lab = Lab(tmp_path)
    lab.write()
    return lab


def test_a_changed_parameter_recomputes_what_depends_on_it(lab):
    lab.make()
    assert lab.make(params={"bed": {"method": "threshold"}})[1] == ["third"]
    assert lab.make(params={"fit": {"debounce": 0.02}})[1] == ["first", "second", "third"]
    assert lab.make()[1] == []  # the first results are still there
    lab.write(toml="[motor_log]\nfile = 'motor.csv'\n[actuation]\nfrequency = 7.0\n")
    assert lab.make()[1] == ["second", "third"]  # what reads a section


def test_another_version_of_a_stage_recomputes_it_and_what_reads_it(lab, monkeypatch):
    """Code that gives other results from the same inputs says so by its version: what the old one made is not taken."""
    lab.make()
    old = pipeline.STAGES[Second]
    newer = replace(old, version=2, function=lambda first, law: Second({**old(first, law).values, "twice": 100}))
    monkeypatch.setitem(pipeline.STAGES, Second, newer)
    values, calls, w = lab.make()
    assert (values["sum"], calls) == (101, ["second", "third"])
    assert [s.state for s in w.steps] == ["cached", "computed", "computed"]
    monkeypatch.setitem(pipeline.STAGES, Second, old)
    assert lab.make()[0]["sum"] == 5  # the results of the first version are still there


def test_a_recording_that_is_exchanged_while_it_is_read_is_no_result(lab):
    MEANWHILE.append(lambda: lab.write("time_s,position_m\n0,1\n2,3\n4,5\n"))
    with pytest.raises(InputError, match=r"motor\.csv: changed while stage 'fit' read it"):
        lab.make()
    MEANWHILE.clear()
    assert lab.make(First)[0]["rows"] == 4


def test_swapped_entries_are_not_taken(lab):
    for value in (0.02, 0.03):
        lab.make(First, params={"fit": {"debounce": value}})
    one, two = (lab.root / "cache" / "fit").iterdir()
    for a, b in ((one, lab.root / "aside"), (two, one), (lab.root / "aside", two)):
        a.rename(b)
    for value in (0.02, 0.03):
        with pytest.warns(StageWarning, match="entry of another key"):
            assert lab.make(First, params={"fit": {"debounce": value}})[0]["debounce"] == value


def test_a_missing_section_or_key_is_named(lab):
    log = "[motor_log]\nfile = 'motor.csv'\n"
    given = {r"\[motor_log\]": "[actuation]\n", r"\[actuation\] freq": f"{log}[actuation]\nfrequency = 13.0\n"}
    for missing, toml in given.items():
        lab.write(toml=toml)
        with pytest.raises(MissingKey, match=f"experiment.toml: .*{missing}"):
            lab.make()


def test_an_error_says_where_and_leaves_nothing_half_written(lab):
    lab.write(toml="[motor_log]\nfile = 'motor.csv'\n[actuation]\nfrequency = 666.0\n")
    with pytest.raises(ValueError, match="no such frequency") as e:
        lab.make()
    assert "in stage 'bed'" in e.value.__notes__[0]
    assert not list((lab.root / "cache").glob("writing-*"))
    assert not (lab.root / "results" / "third.json").exists()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_what_a_killed_process_left_is_swept_though_nobody_asked_for_its_exit_status(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", "pass"])
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)  # it has ended, and stays a zombie
    mine, other = storage.aside_folder(tmp_path), storage.aside_folder(tmp_path)
    dead = other.rename(other.with_name(other.name.replace(f"-{os.getpid()}-", f"-{child.pid}-")))
    storage.sweep_leftovers(tmp_path, tmp_path)
    child.wait()
    assert mine.exists()
    assert not dead.exists()


@pytest.mark.skipif(os.name == "nt", reason="asks processes as POSIX does")
def test_what_another_machine_writes_is_swept_by_age_alone(tmp_path, monkeypatch):
    """Another container's process has a number that here is nobody's; names that are not ours stay for ever."""
    monkeypatch.setattr(os, "getpid", lambda: 2**22 + 5)  # beyond any process here
    mine, old = storage.aside_folder(tmp_path), storage.aside_folder(tmp_path)
    monkeypatch.undo()
    owner = mine.name.split("-")[2]
    theirs, old = (f.rename(f.with_name(f.name.replace(owner, "0123456789ab"))) for f in (mine, old))
    foreign = [tmp_path / "writing-HOST-old", tmp_path / ".notes-a-b.tmp", tmp_path / ".a-1-2.tmp"]
    for f in foreign:
        f.write_text("x")
    for f in (old, *foreign):
        os.utime(f, (time.time() - 2 * storage.ABANDONED,) * 2)
    storage.sweep_leftovers(tmp_path, tmp_path)
    assert theirs.exists() and all(f.exists() for f in foreign) and not old.exists()
