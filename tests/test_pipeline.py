"""The pipeline: nothing recomputed without need, nothing half-written taken for whole."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from jumpvision.base import storage
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.parameters import FitParams
from jumpvision.experiment.inputs.sections import Actuation, MissingKey, MotorLog, NotApplicable, need
from jumpvision.experiment.results.values import Values
from jumpvision.experiment.workflow import stage as stage_module
from jumpvision.experiment.workflow import workspace as pipeline
from jumpvision.experiment.workflow.stage import STAGES, StageWarning, stage
from jumpvision.experiment.workflow.workspace import NotCached, Workspace
from jumpvision.films.parameters import BedParams

CALLS: list[str] = []


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

    def fit(log: MotorLog, *, p: FitParams) -> First:
        CALLS.append("first")
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


def test_a_second_run_recomputes_nothing(lab):
    first, calls, _ = lab.make()
    assert calls == ["first", "second", "third"]
    again, calls, w = lab.make()
    assert (again, calls) == (first, [])
    assert [s.state for s in w.steps] == ["cached"] * 3
    assert json.loads((lab.root / "results" / "third.json").read_text()) == first


def test_a_changed_parameter_recomputes_what_depends_on_it(lab):
    lab.make()
    assert lab.make(params={"bed": {"method": "threshold"}})[1] == ["third"]
    assert lab.make(params={"fit": {"debounce": 0.02}})[1] == ["first", "second", "third"]
    assert lab.make()[1] == []  # the first results are still there


def test_a_changed_section_recomputes_what_reads_it(lab):
    lab.make()
    lab.write(toml="[motor_log]\nfile = 'motor.csv'\n[actuation]\nfrequency = 7.0\n")
    assert lab.make()[1] == ["second", "third"]


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


def test_a_changed_recording_is_noticed_and_a_touched_one_is_not_recomputed(lab):
    lab.make()
    lab.write("time_s,position_m\n0,0\n1,0\n")
    values, calls, _ = lab.make()
    assert (values["sum"], calls) == (7, ["first", "second", "third"])
    os.utime(lab.root / "exp" / "motor.csv")
    assert lab.make()[1] == []


def test_verify_hashes_again_whatever_the_date_says(lab):
    lab.make()
    file = lab.root / "exp" / "motor.csv"
    before = file.stat()
    file.write_text("time_s,position_m\n9,0\n")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    w = Workspace(open_experiment(lab.root / "exp"), lab.root / "results", lab.root / "cache", verify=True)
    CALLS.clear()
    w.make(Third)
    assert CALLS[0] == "first"


def test_moving_the_experiment_recomputes_nothing(lab):
    lab.make()
    (lab.root / "exp").rename(lab.root / "elsewhere")
    toml = lab.root / "elsewhere" / "experiment.toml"
    toml.write_text("name = 'exp'\n" + toml.read_text())
    assert lab.make(where="elsewhere")[1] == []


@pytest.mark.parametrize("damage", ["flip", "truncate", "remove", "receipt"])
def test_a_damaged_cache_entry_is_computed_again(lab, damage):
    good, *_ = lab.make()
    entry = next((lab.root / "cache" / "second").iterdir())
    file = entry / ("receipt.json" if damage == "receipt" else "second.json")
    data = file.read_bytes()
    if damage == "remove":
        file.unlink()
    else:
        file.write_bytes(data[: len(data) // 2] if damage != "flip" else data[:-4] + bytes([data[-4] ^ 1]) + data[-3:])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)
        values, calls, _ = lab.make()
    assert values == good
    assert calls == ["second"]
    assert lab.make()[1] == []


def test_a_lost_result_file_is_put_back(lab):
    lab.make()
    (lab.root / "results" / "third.json").write_text("edited by hand")
    values, calls, _ = lab.make()
    assert calls == []
    assert json.loads((lab.root / "results" / "third.json").read_text()) == values


def test_warnings_stay_with_the_result(lab):
    for _ in range(2):
        w = lab.make(params={"fit": {"debounce": 0.05}})[2]
        assert [t["message"] for t in w.steps[0].warnings] == ["long debounce"]


def test_a_missing_section_is_named(lab):
    lab.write(toml="[actuation]\nfrequency = 7.0\n")
    with pytest.raises(MissingKey, match=r"experiment.toml: bed needs \[motor_log\]"):
        lab.make()


def test_a_missing_key_names_the_file(lab):
    lab.write(toml="[motor_log]\nfile = 'motor.csv'\n[actuation]\nfrequency = 13.0\n")
    with pytest.raises(MissingKey, match=r"experiment.toml: \[actuation\] frequency: missing"):
        lab.make()


def test_an_error_says_where_and_leaves_nothing_half_written(lab):
    lab.write(toml="[motor_log]\nfile = 'motor.csv'\n[actuation]\nfrequency = 666.0\n")
    with pytest.raises(ValueError, match="no such frequency") as e:
        lab.make()
    assert "in stage 'bed'" in e.value.__notes__[0]
    assert not list((lab.root / "cache").glob("writing-*"))
    assert not (lab.root / "results" / "third.json").exists()


def test_a_stage_with_nothing_to_do_is_asked_once(lab):
    """Its reason is remembered; a record that can do without it is made all the same."""

    class Maybe(Values):
        file = "maybe.json"

    class After(Values):
        file = "after.json"

    def track(log: MotorLog) -> Maybe:
        CALLS.append("track")
        raise NotApplicable(["track needs a ball"])

    def piv(maybe: Maybe | None, log: MotorLog) -> After:
        return After({"maybe": maybe is not None})

    track.__annotations__ = {"log": MotorLog, "return": Maybe}
    piv.__annotations__ = {"maybe": Maybe | None, "log": MotorLog, "return": After}
    stage(version=1)(track)
    stage(version=1)(piv)
    for calls in (["track"], []):
        with pytest.raises(NotApplicable, match="needs a ball"):
            lab.make(Maybe)
        assert calls == CALLS
        assert lab.make(After)[0] == {"maybe": False}


def test_only_cached_computes_nothing(lab):
    def make():
        return Workspace(
            open_experiment(lab.root / "exp"), lab.root / "results", lab.root / "cache", computes="nothing"
        ).make(Third)

    with pytest.raises(NotCached):
        make()
    lab.make()
    CALLS.clear()
    make()
    assert CALLS == []


def test_two_stages_for_one_record_are_refused():
    def other(log: MotorLog) -> First:
        return First({})

    other.__annotations__ = {"log": MotorLog, "return": First}
    with pytest.raises(TypeError, match="both make First"):
        stage(version=1)(other)


KILLED = textwrap.dedent("""
    import sys, os, time, pathlib
    from jumpvision.experiment.workflow.workspace import Workspace
    from jumpvision.experiment.workflow.stage import stage
    from jumpvision.experiment.results.values import Values
    from jumpvision.experiment.inputs.experiment import open_experiment
    from jumpvision.experiment.inputs.sections import MotorLog

    class Slow(Values):
        file = "slow.json"
        def save(self, folder):
            text = "[" + ", ".join("1" for _ in range(20000)) + "]"
            with open(folder / self.file, "w") as f:
                for c in range(0, len(text), 2000):
                    f.write(text[c:c+2000]); f.flush(); time.sleep(0.003)

    @stage(version=1)
    def slow(log: MotorLog) -> Slow:
        return Slow({})

    root = pathlib.Path(sys.argv[1])
    print("go", flush=True)
    Workspace(open_experiment(root / "exp"), root / "results", root / "cache").make(Slow)
""")


@pytest.mark.skipif(os.name == "nt", reason="needs SIGKILL")
def test_killed_at_any_moment_it_resumes_with_a_whole_result(lab):
    """Kill -9 at 8 moments spread over the writing of a result; what is there is whole or absent, and a rerun mends."""
    script = lab.root / "slow.py"
    script.write_text(KILLED)
    result = lab.root / "results" / "slow.json"
    for wait in (0.0, 0.01, 0.03, 0.05, 0.07, 0.09, 0.1, 0.12):
        p = subprocess.Popen([sys.executable, script, lab.root], stdout=subprocess.PIPE)
        p.stdout.readline()
        try:
            p.wait(wait)
        except subprocess.TimeoutExpired:
            p.send_signal(signal.SIGKILL)
            p.wait()
        p.stdout.close()
        if result.exists():
            assert len(json.loads(result.read_text())) == 20000
    subprocess.run([sys.executable, script, lab.root], check=True, stdout=subprocess.DEVNULL)
    assert len(json.loads(result.read_text())) == 20000
    storage.sweep_leftovers(lab.root / "results", lab.root / "cache")
    assert not list((lab.root / "cache").glob("writing-*"))
    assert not list((lab.root / "results").glob(".*.tmp"))


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
    monkeypatch.setattr(storage, "_owner", lambda: "0123456789ab")
    monkeypatch.setattr(os, "getpid", lambda: 2**22 + 5)  # beyond any process here
    theirs, old = storage.aside_folder(tmp_path), storage.aside_folder(tmp_path)
    file = storage._aside_file(tmp_path / "fit.json")
    foreign = [tmp_path / "writing-HOST-old", tmp_path / ".notes-a-b.tmp", tmp_path / ".a-1-2.tmp"]
    for f in (file, *foreign):
        f.write_text("x")
    monkeypatch.undo()
    for f in (old, *foreign):
        os.utime(f, (time.time() - 2 * storage.ABANDONED,) * 2)
    storage.sweep_leftovers(tmp_path, tmp_path)
    assert theirs.exists() and file.exists() and all(f.exists() for f in foreign)
    assert not old.exists()


def test_the_registry_of_the_package_is_not_touched_by_these_tests():
    assert First in pipeline.STAGES
    assert First not in STAGES
