"""The house: imports point down, the laboratory shares nothing with the analysis, start-up stays light."""

from __future__ import annotations

import ast
import os
import re
import resource
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from house_counts import BOUNDS, ROOT, counts, floors

FLOORS = floors()  # the table of docs/architecture.md
LEVEL = {name: i for i, floor in enumerate(FLOORS) for name in floor}
CORE = FLOORS[1] | FLOORS[2]


def module_imports(file: Path) -> list[str]:
    """Top names of jumpvision that a file imports, anywhere in it."""
    package = ["jumpvision", *file.relative_to(ROOT).parent.parts]
    out = []
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            full = [*base, *(node.module.split(".") if node.module else [])]
            names = [full] if len(full) > 1 else [[*full, a.name] for a in node.names]
            out += [n[1] for n in names if n[0] == "jumpvision" and len(n) > 1]
        elif isinstance(node, ast.Import):
            out += [a.name.split(".")[1] for a in node.names if a.name.startswith("jumpvision.")]
    return out


FILES = sorted(ROOT.rglob("*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(ROOT)))
def test_imports_point_down(file):
    here = file.relative_to(ROOT).parts[0].removesuffix(".py")
    if here == "__init__" or here == "__main__":
        return
    for name in module_imports(file):
        if name in ("__version__",):
            continue
        if here == "lab":
            assert name in ("lab", "base"), f"the laboratory imports {name}: an error there would cancel"
            continue
        assert name in LEVEL, f"{name} has no floor: add it to docs/architecture.md"
        if name == "lab":
            assert here == "cli", f"{here} imports the laboratory"
        else:
            assert name == here or LEVEL[name] < LEVEL[here], f"{here} imports {name}, which is not below it"


def test_only_what_shows_reads_a_truth():
    """The reader of truth.json is named by the two files that show it, and where it stands."""
    ours = [f for f in FILES if f.relative_to(ROOT).parts[0] != "lab"]
    readers = {str(f.relative_to(ROOT)) for f in ours if "truth_of" in f.read_text()}
    assert readers == {"campaign/truth.py", "report/pages/made.py"}


@pytest.mark.parametrize("file", [f for f in FILES if f.relative_to(ROOT).parts[0] in CORE], ids=lambda f: f.stem)
def test_the_core_neither_prints_nor_plots(file):
    tree = ast.parse(file.read_text())
    calls = {n.func.id for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    assert "print" not in calls
    assert "matplotlib" not in file.read_text()


def test_every_folder_below_the_package_has_a_floor():
    names = {f.relative_to(ROOT).parts[0].removesuffix(".py") for f in FILES} - {"__init__", "__main__"}
    assert names == set(LEVEL)


@pytest.mark.parametrize("name", BOUNDS)
def test_counts_of_the_house(name):
    """Bounds and aims are in house_counts.py; a bound that is not reached any more is to be lowered there."""
    assert counts()[name] <= BOUNDS[name].now


@pytest.mark.parametrize(
    ("words", "seconds"), [(["--help"], 0.3), (["run", "--help"], 1.0), (["sweep", "--help"], 1.0)]
)
def test_help_is_fast_and_light(words, seconds):
    """Nothing heavy is imported for --help; the bounds of its processor time are wide (aims: 0.1 and 0.3 s)."""
    code = (
        "import sys; from jumpvision.cli import main; main(sys.argv[1:]);"
        "heavy = {'numpy', 'scipy', 'numba', 'pandas', 'cv2', 'av', 'xarray', 'matplotlib'};"
        "heavy |= {'cyclopts', 'rich'} if len(sys.argv) == 2 else set();"
        "print(sorted({m.split('.')[0] for m in sys.modules} & heavy))"
    )
    began = resource.getrusage(resource.RUSAGE_CHILDREN)
    out = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True).stdout
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime < seconds
    assert out.strip().splitlines()[-1] == "[]"


@pytest.mark.parametrize("terminal", [{"COLUMNS": "60"}, {"COLUMNS": "137"}, {"PYTHONIOENCODING": "ascii"}], ids=str)
def test_the_page_of_help_is_what_the_library_of_the_command_line_prints(terminal):
    """All but blanks at the ends of lines: the page is written without importing the commands, or the library."""
    ours = "from jumpvision.cli import main; main(['--help'])"
    theirs = "from jumpvision.cli import with_commands; with_commands()(['--help'], result_action='return_value')"
    call = {"capture_output": True, "text": True, "check": True, "env": os.environ | {"NO_COLOR": "1"} | terminal}
    one, other = (subprocess.run([sys.executable, "-c", code], **call).stdout for code in (ours, theirs))
    assert [line.rstrip() for line in one.splitlines()] == [line.rstrip() for line in other.splitlines()]
    assert len(one.splitlines()) > 40


def test_the_conda_recipe_needs_what_pyproject_does():
    """The same packages from the same versions, under conda-forge's names."""
    project = tomllib.loads((ROOT.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    called = {"matplotlib": "matplotlib-base", "opencv-python-headless": "py-opencv", "netCDF4": "netcdf4"}
    wanted = {}
    for text in project["dependencies"]:
        name, versions = re.fullmatch(r"([\w-]+)(.*)", text).groups()
        wanted[called.get(name, name)] = versions.replace("4.10.0.84", "4.10.0")  # the wheel's own fourth number
    wanted["python"] = project["requires-python"]
    recipe = (ROOT.parent / "pipelines" / "packaging" / "recipe.yaml").read_text(encoding="utf-8")
    (run,) = re.findall(r"\n  run:\n((?:    - .*\n)+)", recipe)
    assert dict(line.removeprefix("    - ").split(" ", 1) for line in run.splitlines()) == wanted
    assert f'version: "{project["version"]}"' in recipe
