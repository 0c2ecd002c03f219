"""What README and docs say is what happens: commands, tables, keys."""

from __future__ import annotations

import io
import json
import re
import shlex
from contextlib import redirect_stdout
from functools import cache
from pathlib import Path

import pytest
from conftest import ROOT

from jumpvision.cli import application, main
from jumpvision.experiment.workflow.stage import results_stages

README = (ROOT / "README.md").read_text(encoding="utf-8")
SHOWN = (ROOT / "docs" / "samples.md").read_text(encoding="utf-8")
app = application()
GENERATED = ("api.md", "keys.md", "surprises.md")  # written when the site is built
PAGES = [
    ROOT / "README.md",
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if p.name not in GENERATED),
    ROOT / "data_samples" / "README.md",
]


def commands(page: Path) -> list[str]:
    """Lines of shell blocks that call jumpvision."""
    blocks = re.findall(r"```(?:bash|sh)\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.S)
    return [line for b in blocks for line in b.splitlines() if "jumpvision " in line and not line.startswith("#")]


def test_both_commands_are_one_line_and_do_their_own_set_up():
    run, test = (line for line in README.splitlines() if line.startswith("python3 -m venv .venv && "))
    assert run.endswith("jumpvision run data_samples/loose_sand --results results/loose_sand")
    assert test.endswith("-m pytest")
    for line in (run, test):
        assert ".venv/bin/pip install" in line


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_command_in_the_docs_exists_with_its_options(page):
    for line in commands(page):
        words = shlex.split(line.split("&&")[-1], comments=True)
        arguments = words[[Path(w).name for w in words].index("jumpvision") + 1 :]
        app.parse_args(arguments, print_error=False, exit_on_error=False)  # raises for an unknown command or option


@cache
def help_of(name: str) -> str:
    """What `jumpvision NAME --help` prints."""
    with redirect_stdout(io.StringIO()) as said:
        assert main([name, "--help"]) == 0
    return said.getvalue()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_command_that_a_sentence_quotes_exists_with_its_options(page):
    """In `jumpvision NAME ...` of running text; NAME stands for any."""
    for name, rest in re.findall(r"`jumpvision ([a-z]+)\b([^`]*)`", page.read_text(encoding="utf-8")):
        assert name in app, f"{page.name}: jumpvision {name}"
        for option in re.findall(r"--[a-z][\w-]*", rest):
            assert option in help_of(name), f"{page.name}: jumpvision {name} {option}"


def test_the_readme_says_what_the_page_says():
    verdict = re.search(r"(> The simulation .*?)\n\n", README, flags=re.S).group(1)
    assert verdict in SHOWN


def test_the_table_of_commands_is_complete():
    listed = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`jumpvision (\w+)", listed)) | {"doctor"}
    known = {name for name in app if not name.startswith("-")} - {s.name for s in results_stages()}  # docs/keys.md
    assert known <= named, known - named


def test_the_printed_table_is_that_of_the_page():
    """Experiments, columns and truths as in docs/samples.md; measured values within other machines' last digits."""
    table = re.search(r"<!-- table -->\n```text\n(.*?)```", SHOWN, flags=re.S).group(1)
    for word in ("height [mm]", "true height", "model [mm]", "phi", "mu", "beta [deg]", "added mass [kg]"):
        assert word in table
    assert "The truth is inside 95 % of " in table
    named = re.search(r"<!-- parameters -->\n```text\n(.*?)```", SHOWN, flags=re.S).group(1)
    for head in ("parameter ", "quantity "):
        (columns,) = (line for line in named.splitlines() if line.startswith(head))
        assert " true " in columns and columns.index("true") < columns.index("truth is")
    for name, true in json.loads((ROOT / "data_samples/loose_sand/truth.json").read_text())["parameters"].items():
        rows = [line for line in named.splitlines() if line.split(" ")[0] == name]
        assert all(f"{true:.4g}" in line and "side 95 %" in line for line in rows), name
        assert len(rows) == {"b": 1, "C": 2, "mu": 2, "theta": 2}.get(name, 0)
    names = {f.parent.name for f in (ROOT / "data_samples" / "loose_sand").glob("*/experiment.toml")}
    assert names <= set(re.findall(r"^\S+", table, flags=re.M))


def test_links_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert target in GENERATED or (page.parent / target).exists(), f"{page.name}: {target}"


@pytest.mark.parametrize("name", sorted(n for n in app if not n.startswith("-")))
def test_every_command_has_help_with_an_example(name, capsys):
    assert main([name, "--help"]) == 0
    assert "Example:" in capsys.readouterr().out
