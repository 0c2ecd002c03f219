"""The pages of docs/ do what they say: the tutorial from end to end, data of other programs, every other command."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, SAMPLES
from house_counts import modules, wings
from test_readme import GENERATED, PAGES
from test_vectors import CASES

import jumpvision as jv
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.logs import read_log

DOCS = ROOT / "docs"
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


def tracker(folder: Path) -> None:
    """Tracker's copied table: the name of the mass, then t x y with tabs; a row without a position."""
    t = np.arange(40) / 200
    rows = [f"{a:.4E}\t{0.01:.4E}\t{0.5 - 4.905 * (a - 0.1) ** 2:.6E}" for a in t]
    rows[7] = f"{t[7]:.4E}\t\t"
    (folder / "tracker.txt").write_text("mass A\t\t\nt\tx\ty\n" + "\n".join(rows) + "\n")


def labview(folder: Path) -> None:
    """A .lvm file as a German LabVIEW writes it: two headers, tabs, decimal commas, an empty comment column."""
    rows = [
        f"{i * 1e-3:.6f}\t{9.4 * np.sin(0.04 * i):.6f}\t{11.4 + 0.1 * i:.3f}\t".replace(".", ",") for i in range(60)
    ]
    head = "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\n***End_of_Header***\t\nChannels\t2\n"
    text = head + "***End_of_Header***\t\t\nX_Value\tWeg\tKraft\tComment\n" + "\n".join(rows)
    (folder / "motor.lvm").write_text(text, encoding="latin-1")


def semicolon(folder: Path) -> None:
    """A spreadsheet of a switch's voltage."""
    rows = [f"{i * 1e-3:.3f};{4.9 if i < 30 else 0.1}".replace(".", ",") for i in range(60)]
    (folder / "contact.csv").write_text("Zeit [s];Kontakt [V]\n" + "\n".join(rows) + "\n")


def playback(folder: Path) -> None:
    import cv2

    from jumpvision.films.frames import open_frames

    with open_frames(SAMPLES / "hard_ground" / "rod.avi") as film:
        out = cv2.VideoWriter(str(folder / "rod.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, film.shape[::-1], False)
        for i in range(12):
            out.write(film[i])
        out.release()


def depth(folder: Path) -> None:
    """A crater 20 mm wide in a 120 x 100 mm map."""
    y, x = np.mgrid[:100, :120]
    np.save(folder / "crater.npy", -8.0 * np.exp(-((x - 60.0) ** 2 + (y - 50.0) ** 2) / 200.0))


EXAMPLES = {  # example: what writes the files of the other program, the stage that reads the result, and its file
    "tracker": (tracker, "rod", "rod.csv"), "labview": (labview, None, "motor_log"),
    "semicolon": (semicolon, None, "contact_log"), "playback": (playback, "track", "track.csv"),
    "depth": (depth, "crater", "crater.json"),
    "openpiv": (CASES["openpiv"][0], "flow", "flow.nc"), "pivlab-mat": (CASES["pivlab-mat"][0], "flow", "flow.nc"),
    "pivlab-text": (CASES["pivlab-text"][0], "piv", "piv.nc"), "pivpy-mm": (CASES["pivpy-mm"][0], "piv", "piv.nc"),
}  # fmt: skip
BROUGHT = {
    mark.removeprefix("example: "): {kind: code, **({second: more} if second else {})}
    for mark, kind, code, second, more in BLOCK.findall((DOCS / "bring_your_own_data.md").read_text(encoding="utf-8"))
}


def test_every_example_of_other_programs_is_tried():
    assert set(BROUGHT) == set(EXAMPLES)


@pytest.mark.parametrize("example", EXAMPLES)
def test_data_of_other_programs(example, tmp_path, monkeypatch):
    write, stage, made = EXAMPLES[example]
    folder = tmp_path / "experiment"
    folder.mkdir()
    write(folder)
    if code := BROUGHT[example].get("python"):
        monkeypatch.chdir(folder)
        exec(code, {})
    (folder / "experiment.toml").write_text(BROUGHT[example]["toml"], encoding="utf-8")
    assert main(["check", str(folder)]) == 0
    if stage is None:  # a log that other stages read
        table = read_log(open_experiment(folder).sections[made], *columns(made))
        assert len(table) == 60 and np.allclose(np.diff(table.time_s), 1e-3)
        assert made != "motor_log" or abs(table.position_m.max() - 9.4e-3) < 1e-5
        assert made != "contact_log" or table.contact.sum() == 30
        return
    results = tmp_path / "results"
    assert main([stage, str(folder), "--results", str(results), "--no-pictures"]) == 0
    assert (results / made).exists()
    if example == "tracker":
        assert len((results / made).read_text().splitlines()) == 40  # a header and 39 rows: one had no position
    if example == "playback":
        time = np.loadtxt(results / made, delimiter=",", skiprows=1, usecols=1)
        assert np.allclose(np.diff(time), 1 / 200, rtol=1e-3)  # s: the declared rate, not the file's 25 Hz


def columns(section: str) -> tuple[str, ...]:
    from jumpvision.experiment.init.recognise import LOGS

    return LOGS[section]


def generated(name: str):
    """A module of docs/ that makes a page from the code."""
    sys.path.insert(0, str(DOCS))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.pop(0)


def test_the_types_are_those_of_the_docstrings():
    reference = generated("reference")
    assert reference.STUB.read_text(encoding="utf-8") == reference.stub(), "run: python docs/reference.py"


def test_the_index_lists_every_page():
    for folder, page in ((DOCS, "README.md"), (DOCS / "stages", "../stages.md")):
        index = (folder / page).read_text(encoding="utf-8")
        for p in PAGES:
            assert p.parent != folder or p.name == page or f"{p.name})" in index, p.name


MADE = (".csv", ".json", ".nc", ".npz", ".html", ".png", ".svg", ".pdf", ".webm", ".toml", ".avi", ".mkv", ".md")
PLACES = (ROOT, ROOT / "jumpvision", ROOT / "tests", ROOT / "benchmarks")  # where a path in the text may begin
TEXT = [ROOT / "CONTRIBUTING.md", *PAGES]


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


@pytest.mark.parametrize("page", TEXT, ids=lambda p: p.name)
def test_modules_and_functions_that_a_page_names_exist(page):
    """`room/file.py` from the root, the package, tests or benchmarks; `room.module.function` from the package; modules
    that are run; what a notebook calls."""
    rooms = {p.stem for p in (ROOT / "jumpvision").iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    for quoted in re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8").replace("jv.NAME", "")):
        for path in re.findall(r"[\w./]+\.py\b", quoted):
            assert any((p / path).exists() for p in PLACES), f"{page.name}: {path}"
        dotted = re.fullmatch(r"(jumpvision\.|jv\.)?((\w+)(?:\.\w+)*)(?:\(.*\))?", quoted)
        if dotted and (dotted[1] or ("." in dotted[2] and dotted[3] in rooms)) and not dotted[2].endswith(MADE):
            assert found(dotted[2]), f"{page.name}: {quoted}"
        for module in re.findall(r"python -m (jumpvision[\w.]*|benchmarks[\w.]*)", quoted):
            assert importlib.util.find_spec(module), f"{page.name}: {quoted}"
        folder = re.fullmatch(r"(?:jumpvision/)?((\w+)(?:/\w+)*)/?", quoted)
        if folder and folder[2] in rooms and "/" in quoted and folder[2] != "results":
            assert any((p / folder[1]).exists() for p in PLACES), f"{page.name}: {quoted}"


def test_names_that_contributing_shortens_exist():
    """`module.name` of a module somewhere in the package."""
    quoted = re.findall(r"`((\w+)\.(\w+)[^`\n]*)`", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    short = [(a, b) for text, a, b in quoted if not text.endswith(MADE) and "/" not in text and not b.isupper()]
    assert {("folders", "open_folder"), ("terminal", "result")} <= {*short}
    for module, name in short:
        if module not in ("jv", *wings()):
            named = [m for m in modules() if m.endswith(f".{module}")]
            assert any(hasattr(importlib.import_module(m), name) for m in named), f"{module}.{name}"


def test_sections_of_the_equations_that_code_cites_exist():
    sections = set(re.findall(r"^## (\d+)\.", (DOCS / "physics.md").read_text(encoding="utf-8"), re.M))
    for folder in ("jumpvision", "tests", "benchmarks"):
        for file in (ROOT / folder).rglob("*.py"):
            for cited in re.findall(
                r"docs/physics\.md\s+sections? (\d+)(?: and (\d+))?", file.read_text(encoding="utf-8")
            ):
                assert set(cited) - {""} <= sections, f"{file}: {cited}"


def test_hooks_and_hosted_tests_run_what_the_project_pins():
    yaml = pytest.importorskip("yaml")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (repo,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    tools = {hook["entry"].split()[0] for hook in repo["hooks"]}
    pinned = {p.split("==")[0] for p in project["optional-dependencies"]["dev"] if "==" in p}
    assert tools == pinned and all(hook["language"] == "system" for hook in repo["hooks"])
    job = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))["jobs"]["test"]
    assert project["requires-python"] == f">={job['strategy']['matrix']['python'][0]}"
    assert any((ROOT / step.get("run", "-")).is_file() for step in job["steps"])


def test_the_citation_is_this_package():
    yaml = pytest.importorskip("yaml")
    cff = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {"cff-version", "message", "title", "authors"} <= set(cff)  # what the format requires
    assert (cff["title"], cff["version"], cff["license"]) == (project["name"], project["version"], project["license"])
    assert [a["name"] for a in cff["authors"]] == [a["name"] for a in project["authors"]]
    assert {r["type"] for r in cff["references"]} == {"thesis", "article"}


def parts() -> dict[str, list[str]]:
    """The site's pages by part, as docs/conf.py has them."""
    source = (DOCS / "conf.py").read_text(encoding="utf-8")
    return ast.literal_eval(re.search(r"PARTS = (\{.*?\n\})", re.sub(r"  #.*", "", source), re.S)[1])


def test_every_page_has_its_place_in_the_site():
    placed = [name for names in parts().values() for name in names]
    written = {p.relative_to(DOCS).with_suffix("").as_posix() for p in PAGES if p.is_relative_to(DOCS)}
    assert sorted(placed) == sorted(written - {"README"} | {Path(g).stem for g in GENERATED})


def test_each_public_name_is_told_with_an_example():
    names = [n for n in dir(jv) if not n.startswith("_") and not inspect.ismodule(getattr(jv, n)) and n in jv.__all__]
    assert "piv" in names
    page = generated("reference").text()
    for name in names:
        told = getattr(jv, name).__doc__ or ""
        assert len(told.split()) >= 8, name
        assert (code := re.search(r"^ *Example: (.+)$", told, re.M)) and ast.parse(code[1]), name
        assert f"### {name}\n" in page, name


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site: every link leads somewhere, every page is in the tree, no warning; no network is asked."""
    for package in ("sphinx", "myst_parser", "furo"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("site")
    subprocess.run([sys.executable, "-m", "sphinx", "-q", "-E", "-W", str(DOCS), str(folder)], check=True)
    return folder


@pytest.mark.long
def test_the_site_begins_with_which_page_do_i_need(site):
    first = (site / "index.html").read_text(encoding="utf-8")
    assert "Which page do I need?" in first and "search.html" in first
    for page in DOCS.rglob("*.md"):
        name = page.relative_to(DOCS).with_suffix(".html").as_posix()
        assert (site / name).exists()
        assert name == "README.html" or f'href="{name}' in first, name


@pytest.mark.long
def test_the_site_is_searched_from_its_first_page(site, browser):
    """Opened from the disk, without a server."""
    page = browser.new_page()
    page.goto((site / "index.html").as_uri())
    page.fill("input[name=q]", "vorticity")
    page.press("input[name=q]", "Enter")
    page.wait_for_selector("#search-results li a[href^='velocity_fields.html']", timeout=10_000)
    assert "found" in page.inner_text("#search-results")
    page.close()


def test_every_figure_of_the_thesis_has_a_command_or_a_script_or_is_a_sketch():
    """Fig 14 and those of chapters II to IV, 18 to 69: in docs/figures.md or in the table of the scripts."""
    page = (DOCS / "figures.md").read_text(encoding="utf-8")
    scripts = (ROOT / "pipelines" / "thesis" / "README.md").read_text(encoding="utf-8")
    shown = {
        *re.findall(r"^\| (\d+) \| `", page, re.M),
        *re.findall(r"\d+", re.search(r"sketches have none: ([^.]+)", page)[1]),
    }
    for figures in re.findall(r"^\| \[`fig\w+\.py`\]\S+ \| ([^|]+)", scripts, re.M):
        shown |= set(re.findall(r"\d\d", figures))
    assert {14, *range(18, 70)} <= {int(n) for n in shown}
    known = known_commands()
    for command in re.findall(r"`jumpvision ([^`]+)`", page):
        words = shlex.split(command)
        assert words[0] in known, command
        if words[1:] and words[1].startswith("data_samples"):
            assert (ROOT / words[1] / "experiment.toml").exists(), command


def known_commands() -> set[str]:
    """As the help lists them."""
    said = subprocess.run(
        [sys.executable, "-c", "from jumpvision.cli import main; main(['--help'])"],
        capture_output=True,
        text=True,
        env=environment(ROOT),
    ).stdout
    return set(re.findall(r"^│ ([a-z]+) ", said, re.M))
