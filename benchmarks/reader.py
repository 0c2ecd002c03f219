"""Every command of the documentation in one shell, one after the other, page by page as the site has them.

`python -m benchmarks.reader [--keep FOLDER] [--pages NAME,NAME]` prints a table, what failed first. The shell begins in
a folder with the sample data and the files that pages show (blocks marked `file:`); blocks marked `append to` are added
where they stand. What a user does and no page shows comes first (BESIDE): streams that close, narrow terminals, a film
alone, and the first result of each guide, which must come within a minute (FIRST). Servers get Ctrl-C after some
seconds. A command with a word in capitals (CAMPAIGN) is a pattern to be filled in and is not run.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"(?:<!-- (?P<mark>[^>]*?) -->\n)?```(?P<kind>\w*)\n(?P<code>.*?)```", re.S)
PATTERN = re.compile(r"\b[A-Z]{4,}\b")
WAIT, ENDED = 12, 124  # s, for a server to be up, before Ctrl-C; the exit code of `timeout` then
BESIDE = "beside the pages"
FIRST = 60  # s, to the first useful result of a guide
FILM = "data_samples/loose_sand/stutter-7.0Hz-film"
BY_HAND = (  # each ends with 0 where all is right
    # the first results of the guides: films, pictures of grains, a simulator of one's own
    f"timeout {FIRST} jumpvision track data_samples/hard_ground/rod.avi --results first/track",
    f"timeout {FIRST} jumpvision piv {FILM}/grains.mkv --no-pictures --results first/piv",
    f"timeout {FIRST} python any_simulator.py",
    # streams: closed, narrow, none
    "jumpvision --help | true; test ${PIPESTATUS[0]} = 0",
    "jumpvision --version | true; test ${PIPESTATUS[0]} = 0",
    "jumpvision run data_samples/hard_ground --results first/cut | head -1; test ${PIPESTATUS[0]} = 0",
    "test -s first/cut/report.html",
    "jumpvision check data_samples/hard_ground >&-",
    "COLUMNS=1 timeout 30 jumpvision check data_samples/hard_ground",
    "COLUMNS=0 timeout 30 jumpvision --help",
    "timeout --preserve-status -s INT 8 jumpvision run data_samples/loose_sand --results first/stopped > cut.txt 2>&1; "
    "test $? = 130 && grep -q 'run the same command again to resume' cut.txt",
    # what lacks is said by check as by run, all at once; what can be done is done
    f"mkdir -p bare && cp {FILM}/rod.avi {FILM}/grains.mkv {FILM}/bed.png {FILM}/motor.csv bare",
    "jumpvision check bare 2>&1 | grep -q 'jumpvision init bare writes one'",
    "jumpvision init bare --marks 12,40,12,540 --distance-mm 250",
    "jumpvision check bare 2> all.txt; test $? = 2 && grep -q floor_row all.txt && grep -q 'bed_image. scale' all.txt",
    "jumpvision run bare --no-pictures --results first/bare 2> part.txt; test $? = 1 && grep -q '1 in part' part.txt",
    "test -s first/bare/track.csv && test -s first/bare/piv.nc",
    # results of samples never lie among them
    "jumpvision track data_samples/hard_ground --no-pictures && test -s results/hard_ground/track.csv",
    "test ! -e data_samples/results",
    # the verdict is the first thing on stdout
    "jumpvision run data_samples/loose_sand --results results/loose_sand | head -1 | grep -q 'because it lacks'",
)
ENV = "python3 -m venv"  # the README's own line makes an environment: its last part runs in this one


class Command(NamedTuple):
    """A line of a page."""

    page: str
    line: str

    @property
    def pattern(self) -> bool:
        """Whether a reader has to fill it in."""
        return self.page != BESIDE and bool(PATTERN.search(self.line.split("#")[0]))

    @property
    def script(self) -> str:
        """What the shell is given."""
        if self.page == BESIDE:
            return f"( {self.line} )"
        line = self.line.split("&&")[-1].replace(".venv/bin/", "").strip() if ENV in self.line else self.line
        words = line.split("#")[0].split()
        serves = "--export" not in words and (words[1:2] in (["open"], ["demo"]) or "--pick" in words)
        return f"timeout -s INT {WAIT} {line}" if serves else line


def pages() -> list[Path]:
    """README, then the site's, in order."""
    sys.path.insert(0, str(DOCS))
    from conf import PARTS

    return [ROOT / "README.md", *(DOCS / f"{name}.md" for part in PARTS.values() for name in part)]


def blocks(page: Path) -> Iterator[tuple[str, str, str]]:
    """(mark, kind, code) of a page's blocks."""
    for m in BLOCK.finditer(page.read_text(encoding="utf-8")):
        yield m["mark"] or "", m["kind"], m["code"]


def commands(page: Path) -> list[Command]:
    """The commands of a page: lines of blocks of the shell, or of no language, that begin with one."""
    shown = [code for _, kind, code in blocks(page) if kind in ("bash", "") and "-m pytest" not in code]
    lines = [x for code in shown for x in code.splitlines()]
    return [Command(page.name, x) for x in lines if re.match(r"(jumpvision|cp|mkdir|cat|python3 -m venv) ", x)]


def prepare(page: Path, folder: Path) -> None:
    """The files that a page shows."""
    for mark, _, code in blocks(page):
        if mark.startswith("file: "):
            (folder / mark.removeprefix("file: ")).write_text(code, encoding="utf-8")


def brought(folder: Path) -> None:
    """What a reader of the pages on forces brings: the mesh of a foot, a table of stresses."""
    a, b = np.array([[0, 0, 0], [30, 0, 0], [0, 30, 0], [0, 0, 30.0]]), [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*a[i]) for i in f)
        + "endloop\nendfacet\n"
        for f in b
    )
    (folder / "foot.stl").write_text(f"solid foot\n{facets}endsolid foot\n")
    angles = np.radians(np.arange(-90, 91, 30))
    rows = [
        f"{math.degrees(p):g},{math.degrees(m):g},{0.1 * math.cos(m):g},{0.2 * math.sin(m):g}"
        for p in angles
        for m in angles
    ]
    head = "plate [deg],motion [deg],alpha_x [N/cm^3],alpha_z [N/cm^3]"
    (folder / "stresses.csv").write_text("\n".join([head, *rows]) + "\n")


def appended(page: Path) -> dict[str, str]:
    """What a page says to append to files, by file."""
    marks = [(m, code) for m, _, code in blocks(page) if m.startswith("append to ")]
    return {m.removeprefix("append to "): code for m, code in marks}


def first_program(page: Path) -> str:
    """The first block of Python that runs as it stands."""
    return next(code for mark, kind, code in blocks(page) if kind == "python" and not mark)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path, help="folder of the shell, kept")
    parser.add_argument("--pages", default="", help="only these, comma apart")
    args = parser.parse_args()
    folder = args.keep or Path(tempfile.mkdtemp(prefix="reader-"))
    made = shutil.ignore_patterns("results")
    shutil.copytree(ROOT / "data_samples", folder / "data_samples", dirs_exist_ok=True, ignore=made)
    shutil.copytree(ROOT / "pipelines", folder / "pipelines", dirs_exist_ok=True)
    brought(folder)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    env = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT), "HOME": str(folder), "BROWSER": "true"}
    for page in pages():
        prepare(page, folder)
    told: list[tuple[int, float, Command]] = []
    signal.signal(signal.SIGINT, signal.default_int_handler)  # begun in the background, all below would ignore it
    shell = subprocess.Popen(
        ["bash"],
        cwd=folder,
        env=env,
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    assert shell.stdin is not None and shell.stdout is not None
    (folder / "any_simulator.py").write_text(first_program(DOCS / "any_simulator.md"), encoding="utf-8")
    for page in [Path(BESIDE), *pages()]:
        if args.pages and page.stem not in args.pages.split(","):
            continue
        by_hand = page.name == BESIDE
        later = {} if by_hand else appended(page)
        for command in [Command(BESIDE, x) for x in BY_HAND] if by_hand else commands(page):
            if command.pattern:
                told.append((-1, 0.0, command))
                continue
            for file in list(later):
                if (folder / file).exists() and "init" not in command.line:
                    with (folder / file).open("a", encoding="utf-8") as f:
                        f.write("\n" + later.pop(file))
            typed = command.script if by_hand else command.script.split("#")[0]
            shell.stdin.write(f"s=$EPOCHREALTIME; {typed} < /dev/null; ")
            shell.stdin.write('\necho "##ended $? $s $EPOCHREALTIME"\n')
            shell.stdin.flush()
            said = []
            for line in shell.stdout:
                if line.startswith("##ended "):
                    code, began, end = line.split()[1:]
                    break
                said.append(line)
            else:
                raise SystemExit("the shell ended")
            told.append((int(code), float(end) - float(began), command))
            print(f"{code:>4} {float(end) - float(began):7.1f} s  {page.name}: {command.line}", file=sys.stderr)
            if not right(int(code), command):
                print("".join(said[-6:]), file=sys.stderr)
    print("| exit code | seconds | page | command |\n|---|---|---|---|")
    for code, seconds, c in sorted(told, key=lambda x: (right(x[0], x[2]), x[0] == -1, -x[1])):
        print(f"| {'pattern' if code == -1 else code} | {seconds:.1f} | {c.page} | `{c.line.split(' #')[0].strip()}` |")
    if not args.keep:
        shutil.rmtree(folder)
    sys.exit(not all(right(code, c) for code, _, c in told))


def right(code: int, command: Command) -> bool:
    """Whether a line did what it should: a server of a page is stopped, a first result may not be."""
    return code in (0, -1) or (code == ENDED and command.page != BESIDE)


if __name__ == "__main__":
    main()
