"""doctor and completion."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from jumpvision.cli import doctor, main


def test_doctor_says_what_there_is(tmp_path, capsys):
    assert main(["doctor", str(tmp_path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert "mjpeg" in facts["video codecs"] and "may be used" in facts["cores"]
    free = shutil.disk_usage(tmp_path).free / 1e9
    assert facts["results and cache"].startswith(f"{tmp_path}: ")
    assert abs(float(facts["results and cache"].split(": ")[1].split()[0]) - free) < 1
    assert main(["doctor"]) == 0
    assert "remedy" in capsys.readouterr().out


def test_doctor_names_a_remedy_for_what_lacks(monkeypatch, tmp_path):
    def absent(name):
        raise doctor.PackageNotFoundError(name)

    monkeypatch.setattr(doctor, "version", absent)
    remedies = {what: remedy for what, _, remedy in doctor.packages()}
    assert remedies["casadi"] == 'pip install "jumpvision[plan]"' and "reinstall" in remedies["numpy"]
    monkeypatch.setattr(shutil, "disk_usage", lambda p: type("Usage", (), {"free": 1e9}))
    assert all("little left" in found and "cache" in remedy for _, found, remedy in doctor.disk(tmp_path))


def test_doctor_refuses_a_folder_that_is_not_there(tmp_path, capsys):
    assert main(["doctor", str(tmp_path / "none")]) == 2
    assert "no such folder" in capsys.readouterr().err


BASH = """
source "$1"
COMP_WORDS=(jumpvision $2); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); COMP_LINE="jumpvision $2"; COMP_POINT=${#COMP_LINE}
function_=$(complete -p jumpvision | sed 's/.*-F \\([^ ]*\\).*/\\1/')
$function_ jumpvision "${COMP_WORDS[COMP_CWORD]}" ""
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
@pytest.mark.parametrize(("typed", "wanted"), [("tra", "track"), ("dia", "diagnose"), ("track --res", "--results")])
def test_bash_completes(tmp_path, capsys, typed, wanted):
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "jumpvision.bash"
    script.write_text(capsys.readouterr().out)
    env = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    out = subprocess.run(["bash", "-c", BASH, "bash", str(script), typed], capture_output=True, text=True, env=env)
    assert [w.strip() for w in out.stdout.split()] == [wanted], out.stderr


def test_installing_writes_into_the_home_folder_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert main(["completion", "fish", "--install"]) == 0
    written = list(tmp_path.rglob("jumpvision.fish"))
    assert len(written) == 1 and str(written[0]) in capsys.readouterr().err
