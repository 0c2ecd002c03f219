"""The pages of docs/ do what they say: the tutorial from end to end, data of other programs, every other command."""

from __future__ import annotations

import importlib.util
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest
from shared import ROOT, SAMPLES

from jumpvision.cli import application, main
from jumpvision.experiment.inputs.experiment import open_experiment
from tests.worlds.small import make, problems_of

DOCS = ROOT / "docs"
GENERATED = ("api.md", "keys.md", "surprises.md")  # written when the site is built
PAGES = [ROOT / "README.md", *sorted(p for p in DOCS.rglob("*.md") if p.name not in GENERATED)]
PAGES += [ROOT / "data_samples" / "README.md"]
BLOCK = re.compile(r"<!-- (.*?) -->\n```(bash|toml|python)\n(.*?)```(?:\n+```(toml)\n(.*?)```)?", re.S)


def environment(folder: Path) -> dict[str, str]:
    """With this package, and the command of this Python first."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return os.environ | {"PATH": path, "PYTHONPATH": str(ROOT), "HOME": str(folder)}


@pytest.mark.long
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_the_tutorial_from_end_to_end(tmp_path, monkeypatch, capsys):
    """Every line by bash; but for the first, commands of this program in this process, which has what they import."""
    page = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    shutil.copytree(SAMPLES / "hard_ground", tmp_path / "data_samples" / "hard_ground")
    monkeypatch.chdir(tmp_path)
    typed = 0
    for mark, kind, code, *_ in BLOCK.findall(page):
        if mark.startswith("append to "):
            with (tmp_path / mark.removeprefix("append to ")).open("a", encoding="utf-8") as f:
                f.write("\n" + code)
        elif mark == "run":
            assert kind == "bash"
            for line in code.splitlines():
                if line.startswith("jumpvision ") and typed:
                    assert main(shlex.split(line)[1:]) == 0, line + capsys.readouterr().err
                    continue
                typed += line.startswith("jumpvision ")
                command = ["bash", "-e", "-c", line]
                done = subprocess.run(command, cwd=tmp_path, env=environment(tmp_path), capture_output=True, text=True)
                assert done.returncode == 0, line + done.stderr
    said = capsys.readouterr().out
    assert re.search(r"stutter-8.2Hz-1 +33\.\d\d ± 0\.33 +33\.1", said)  # as the page prints it
    truth = json.loads((SAMPLES / "hard_ground" / "truth.json").read_text())["summary"]["jump_height_m"]
    found = json.loads((tmp_path / "results" / "my_jumps" / "stutter-8.2Hz-1" / "summary.json").read_text())
    assert 0.005 < found["jump_height_m"] / truth - 1 < 0.012  # the page: 0.9 % by the ball's diameter
    assert abs(found["jump_height_m"] - truth) < found["sigma_m"]  # which states 1 %
    assert found["sigma_common_m"] / found["jump_height_m"] == pytest.approx(0.01, rel=0.01)
    assert (tmp_path / "results" / "my_jumps" / "report.html").exists()


def test_keys_of_the_examples_of_other_programs_are_known(tmp_path):
    """Of docs/bring_your_own_data.md; their files, which are not here, are all that is missing."""
    text = (DOCS / "bring_your_own_data.md").read_text(encoding="utf-8")
    examples = re.findall(r"```toml\n(.*?)```", text, re.S)
    assert len(examples) >= 9
    for example in examples:
        found = problems_of(open_experiment, make(tmp_path, example))
        assert all(re.search("no such file|nothing matches|matches this pattern", f) for f in found), found


def test_the_types_are_those_of_the_docstrings(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    reference = importlib.import_module("reference")
    assert reference.STUB.read_text(encoding="utf-8") == reference.stub(), "run: python docs/reference.py"


MADE = (".csv", ".json", ".nc", ".npz", ".html", ".png", ".svg", ".pdf", ".webm", ".toml", ".avi", ".mkv", ".md")
# where a path in the text may begin
PLACES = (ROOT, ROOT / "jumpvision", ROOT / "benchmarks", ROOT / "tests", *(ROOT / "tests").glob("*/"))


def found(dotted: str) -> bool:
    """Whether a dotted name exists in the package."""
    parts = dotted.split(".")
    for k in range(len(parts), -1, -1):
        try:
            here: object = importlib.import_module(".".join(["jumpvision", *parts[:k]]))
        except ModuleNotFoundError:
            continue
        for name in parts[k:]:
            here = getattr(here, name, None)
        return here is not None
    return False


def test_modules_and_functions_that_a_page_names_exist():
    """`room/file.py` from the root, the package, tests or benchmarks; `room.module.function` from the package; modules
    that are run; what a notebook calls."""
    rooms = {p.stem for p in (ROOT / "jumpvision").iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    for page in [ROOT / "CONTRIBUTING.md", *PAGES]:
        for quoted in re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8").replace("jv.NAME", "")):
            for path in re.findall(r"[\w./]+\.py\b", quoted):
                there = any((p / path).exists() for p in PLACES) or any((ROOT / "tests").rglob(path))
                assert there, f"{page.name}: {path}"
            dotted = re.fullmatch(r"(jumpvision\.|jv\.)?((\w+)(?:\.\w+)*)(?:\(.*\))?", quoted)
            if dotted and (dotted[1] or ("." in dotted[2] and dotted[3] in rooms)) and not dotted[2].endswith(MADE):
                assert found(dotted[2]), f"{page.name}: {quoted}"
            for module in re.findall(r"python -m (jumpvision[\w.]*|benchmarks[\w.]*)", quoted):
                assert importlib.util.find_spec(module), f"{page.name}: {quoted}"


def test_every_command_in_the_docs_exists_with_its_options():
    """In shell blocks, and in `jumpvision NAME ...` of running text; every command has help with an example."""
    app = application()
    said = {}
    for name in (n for n in app if not n.startswith("-")):
        with redirect_stdout(io.StringIO()) as out:
            assert main([name, "--help"]) == 0
        said[name] = out.getvalue()
        assert "Example:" in said[name], name
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for block in re.findall(r"```(?:bash|sh)\n(.*?)```", text, flags=re.S):
            for line in (x for x in block.splitlines() if "jumpvision " in x and not x.startswith("#")):
                words = shlex.split(line.split("&&")[-1], comments=True)
                arguments = words[[Path(w).name for w in words].index("jumpvision") + 1 :]
                app.parse_args(arguments, print_error=False, exit_on_error=False)  # raises for an unknown one
        for name, rest in re.findall(r"`jumpvision ([a-z]+)\b([^`]*)`", text):
            for option in re.findall(r"--[a-z][\w-]*", rest):
                assert option in said[name], f"{page.name}: jumpvision {name} {option}"


def test_links_lead_somewhere_and_readmes_commands_do_their_own_set_up():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert target in GENERATED or (page.parent / target).exists(), f"{page.name}: {target}"
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    run, test = (line for line in lines if line.startswith("python3 -m venv .venv && "))
    assert run.endswith("jumpvision run data_samples/loose_sand --results results/loose_sand")
    assert test.endswith("-m pytest") and all(".venv/bin/pip install" in line for line in (run, test))
