"""The house: imports point down, the laboratory shares nothing with the analysis, start-up stays light."""

from __future__ import annotations

import ast
import io
import re
import resource
import subprocess
import sys
import tomllib

import pytest
from house_counts import DOORS, ROOT, circles, imports, loaded, modules, upward, wings
from pace import in_time
from rich.console import Console

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


@pytest.mark.parametrize("door", ["jv.piv(a, b)", "jv.track(frames)"])
def test_a_function_of_arrays_loads_what_it_needs(door):
    """No stage, no page, no laboratory: what a door opens on is read in an afternoon."""
    files, lines = loaded(DOORS[door])
    assert files <= 45 and lines <= 10_000


def test_the_door_of_the_films_opens():
    from jumpvision import films

    assert all(getattr(films, name).__doc__ for name in films.__all__)
    with pytest.raises(AttributeError, match="no attribute 'pvi'"):
        films.pvi  # noqa: B018


@pytest.mark.parametrize("name", LABORATORY)
def test_the_laboratory_shares_nothing_with_the_analysis(name):
    """An error in both would cancel: what draws recordings imports `base` alone, only the command line imports it."""
    assert all(i in LABORATORY or i.startswith("jumpvision.base") for i in imports(name) - {"jumpvision"})
    users = [n for n in modules() if name in imports(n)]
    assert all(n in LABORATORY or n.startswith("jumpvision.cli") for n in users)


def test_commands_and_analysis_load_no_laboratory():
    """All of them but, inside their functions, the commands `synth` and `dem`."""
    ours = [n for n in modules() if not n.startswith("jumpvision.laboratory")]
    ours.remove("jumpvision.__main__")
    code = f"import importlib, sys\nfor n in {ours}: importlib.import_module(n)\n"
    code += "print(*(m for m in sys.modules if m.startswith('jumpvision.laboratory')))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == ""


def test_only_what_shows_reads_a_truth():
    """The reader of truth.json is named by the two files that show it, and where it stands."""
    ours = [f for f in modules().values() if f.relative_to(ROOT).parts[0] != "laboratory"]
    readers = {str(f.relative_to(ROOT)) for f in ours if "truth_of" in f.read_text()}
    assert readers == {"experiment/campaign/truth.py", "report/pages/report.py"}


@pytest.mark.parametrize("name", CORE)
def test_the_core_neither_prints_nor_plots(name):
    text = modules()[name].read_text()
    calls = {n.func.id for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    assert name in LABORATORY or "print" not in calls
    assert "matplotlib" not in text


def test_a_diagnosis_loads_the_engine_alone():
    """The limits of what a user of another simulator has to load, of a diagnosis from beginning to end."""
    files, lines = loaded(DOORS["jv.diagnose(recordings, study)"])
    assert files <= 45 and lines <= 9000


@pytest.mark.parametrize("words", [["--help"], ["run", "--help"], ["sweep", "--help"]])
def test_help_is_fast_and_light(words):
    """Nothing heavy is imported for --help; the bound of its processor time is wide (measured: 0.2 s)."""
    code = (
        "import sys; from jumpvision.cli import main; main(sys.argv[1:]);"
        "heavy = {'numpy', 'scipy', 'numba', 'pandas', 'cv2', 'av', 'xarray', 'matplotlib'};"
        "print(sorted({m.split('.')[0] for m in sys.modules} & heavy))"
    )

    def used() -> float:
        began = resource.getrusage(resource.RUSAGE_CHILDREN)
        out = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True).stdout
        assert out.strip().splitlines()[-1] == "[]"
        ended = resource.getrusage(resource.RUSAGE_CHILDREN)
        return 1e3 * (ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime)

    in_time(used, 1e3)


def test_a_calibrated_number_is_used_and_judged_by_what_is_there():
    """A list of numbers grows stale: each is used where it says, and what judges it can be run."""
    from jumpvision.films import calibration

    records = {n: r for n, r in vars(calibration).items() if isinstance(r, calibration.Calibrated)}
    text = "".join(f.read_text(encoding="utf-8") for n, f in modules().items() if not n.endswith("films.calibration"))
    assert len(records) > 20
    for name, r in records.items():
        assert f"{name}.value" in text, name
        assert r.judged_by == "none" or (ROOT.parent / r.judged_by).exists(), r.judged_by
        assert re.fullmatch(r"20\d\d-\d\d-\d\d", r.date) and r.on and r.enters


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


@pytest.mark.parametrize("command", ["sweep", "plan", "dem", "init", "run"])
def test_help_of_a_command_says_every_option(command):
    """A group that is None would hide an option."""
    from jumpvision.cli import application

    app = application()[command]
    said = io.StringIO()
    app.help_print(console=Console(file=said, width=200))
    names = {n for a in app.assemble_argument_collection() if a.parameter.show is not False for n in a.names}
    assert len(names) > 5 and [n for n in names if n.startswith("--") and n not in said.getvalue()] == []
