"""doctor and completion."""

from __future__ import annotations

import json
import shutil

from jumpvision.cli import doctor, main


def test_doctor_says_what_there_is(tmp_path, capsys):
    assert main(["doctor", str(tmp_path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert "mjpeg" in facts["video codecs"] and "may be used" in facts["cores"]
    free = shutil.disk_usage(tmp_path).free / 1e9
    assert facts["results and cache"].startswith(f"{tmp_path}: ")
    assert abs(float(facts["results and cache"].split(": ")[1].split()[0]) - free) < 1
    assert main(["doctor"]) == 0 and main(["doctor", str(tmp_path / "none")]) == 2


def test_doctor_names_a_remedy_for_what_lacks(monkeypatch, tmp_path):
    def absent(name):
        raise doctor.PackageNotFoundError(name)

    monkeypatch.setattr(doctor, "version", absent)
    remedies = {what: remedy for what, _, remedy in doctor.packages()}
    assert remedies["casadi"] == 'pip install "jumpvision[plan]"' and "reinstall" in remedies["numpy"]
    monkeypatch.setattr(shutil, "disk_usage", lambda p: type("Usage", (), {"free": 1e9}))
    assert all("little left" in found and "cache" in remedy for _, found, remedy in doctor.disk(tmp_path))
