"""The house: imports point down, the laboratory shares nothing with the analysis, start-up stays light."""

from __future__ import annotations

import ast
import io
import subprocess
import sys

from house_counts import ROOT, circles, imports, modules, tree, upward, wings
from rich.console import Console

from jumpvision.cli import application

CORE = [n for n in modules() if n.split(".")[1:2] and 2 <= wings()[n.split(".")[1]].floor <= 4]
LABORATORY = [n for n in modules() if n.startswith("jumpvision.laboratory")]


def test_imports_point_down():
    assert list(upward()) == []


def test_every_room_has_its_place_in_the_table():
    assert {n.split(".")[1] for n in modules() if "." in n} == set(wings())
    for name, wing in wings().items():
        if wing.rooms:
            assert {n.split(".")[2] for n in modules() if n.startswith(f"jumpvision.{name}.")} == set(wing.rooms)


def test_no_two_modules_import_each_other():
    assert circles() == []


def test_the_laboratory_shares_nothing_with_the_analysis():
    """An error in both would cancel: what draws recordings imports `base` alone, only the command line imports it, and
    that inside its functions. The reader of truth.json is named by the two files that show it, and where it stands."""
    for name in LABORATORY:
        assert all(i in LABORATORY or i.startswith("jumpvision.base") for i in imports(name) - {"jumpvision"}), name
        users = [n for n in modules() if name in imports(n)]
        assert all(n in LABORATORY or n.startswith("jumpvision.cli") for n in users), name
    ours = [f for f in modules().values() if f.relative_to(ROOT).parts[0] != "laboratory"]
    readers = {str(f.relative_to(ROOT)) for f in ours if "truth_of" in f.read_text()}
    assert readers == {"experiment/campaign/truth.py", "report/pages/report.py"}


def test_commands_load_the_laboratory_inside_their_functions():
    users = [n for n in modules() if imports(n) & {*LABORATORY} and n not in LABORATORY]
    assert users
    for name in users:
        for node in tree(modules()[name]).body:
            assert not (isinstance(node, ast.Import | ast.ImportFrom) and "laboratory" in ast.unparse(node)), name


def test_the_core_neither_prints_nor_plots():
    for name in CORE:
        text, nodes = modules()[name].read_text(), ast.walk(tree(modules()[name]))
        calls = {n.func.id for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        assert (name in LABORATORY or "print" not in calls) and "matplotlib" not in text, name


def test_help_and_the_import_are_light():
    """Nothing heavy is imported until a stage is asked for."""
    code = (
        "import sys, jumpvision; from jumpvision.cli import main; sys.argv[1:] and main(sys.argv[1:]);"
        "heavy = {'numpy', 'scipy', 'numba', 'pandas', 'cv2', 'av', 'xarray', 'matplotlib'};"
        "print(sorted({m.split('.')[0] for m in sys.modules} & heavy))"
    )
    for words in ([], ["--help"], ["run", "--help"], ["sweep", "--help"]):
        out = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True).stdout
        assert out.strip().splitlines()[-1] == "[]", words


def test_help_of_a_command_says_every_option():
    """A group that is None would hide an option."""
    for command in ("sweep", "plan", "dem", "init", "run"):
        app = application()[command]
        said = io.StringIO()
        app.help_print(console=Console(file=said, width=200))
        names = {n for a in app.assemble_argument_collection() if a.parameter.show is not False for n in a.names}
        assert len(names) > 5 and [n for n in names if n.startswith("--") and n not in said.getvalue()] == []
