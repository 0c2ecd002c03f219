"""One height for one jump in sealed worlds: `python -m benchmarks.sealed_heights [worlds] [first seed] [workers]`.

Each world is a campaign of `jumpvision synth blind`, on sand and hard ground in turn, run and diagnosed as it stands;
what is true of its jumps is drawn again from the same seed, aside. `measured_m` of diagnosis.json must be that of
jumps.csv to the last digit, and the truth within 2 sigma in 95 of 100. A world whose effect sits in the camera is
apart: its heights are off by what is hidden. Worlds that fail come first. 12 worlds: 15 to 30 minutes on one core.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.rows import Numbered, Row, gather, interval
from jumpvision.cli import main as command
from jumpvision.laboratory.blind import draw
from jumpvision.laboratory.campaign import carry_out
from jumpvision.laboratory.jumper import AT_THE_CAMERA
from jumpvision.laboratory.seal import write_blind

GROUNDS = ("granular", "hard")


def world(case: Numbered) -> Row:
    """A campaign: its jumps, those whose two heights are one, and (measured - true) / sigma of each."""
    ground = GROUNDS[case.number % 2]
    with tempfile.TemporaryDirectory() as place:
        seen, true, results = (Path(place) / name for name in ("world", "true", "results"))
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            write_blind(seen, seed=case.seed, ground=ground)
            code = command(["run", str(seen), "--results", str(results), "--no-pictures", "--workers", "1"])
        if code:
            raise RuntimeError(f"run ends with {code}")
        setting = draw(np.random.default_rng([case.seed, 1]), ground=ground)
        true.mkdir()
        carry_out([(setting.protocol, j) for j in setting.protocol.jumps], true, seed=case.seed, workers=1)
        table = pd.read_csv(results / "jumps.csv").set_index("experiment")
        told = {h["experiment"]: h for h in json.loads((results / "diagnosis.json").read_text())["heights"]}
        heights = [height(true / name, row, told.get(name)) for name, row in table.iterrows()]
    return {
        "ground": ground,
        "hidden": list(setting.hidden),
        "camera": bool({*setting.hidden} & {*AT_THE_CAMERA}),
        "same": sum(h["same"] for h in heights),
        "heights": heights,
    }


def height(folder: Path, row: Any, told: dict[str, Any] | None) -> dict[str, Any]:
    """Of a jump; told: the diagnosis' line, none where the table has no height either."""
    measured, sigma = float(row.jump_height_m), float(row.sigma_m)
    true = json.loads((folder / "truth.json").read_text())["summary"]["jump_height_m"]
    same = told is None if np.isnan(measured) else told is not None and told["measured_m"] == measured
    return {"same": bool(same), "measured_m": measured, "true_m": true, "z": (measured - true) / sigma}


def main(worlds: str = "12", first: str = "20141126", workers: str = "1", file: str = "") -> None:
    """Print the table of the worlds and the two shares."""
    cases = [Numbered(i, int(first) + i) for i in range(int(worlds))]
    rows = gather(cases, world, file or None, int(workers))
    print("| world | ground | hidden | jumps | one height | truth within 2 sigma | worst z |")
    print("|---|---|---|---|---|---|---|")
    for row in sorted(rows, key=badness):
        if "failed" in row:
            print(f"| {row['key']} | failed: {row['failed']} | | | | | |")
            continue
        z, hidden = scores([row]), ", ".join(row["hidden"]) or "nothing"
        n = len(row["heights"])
        print(
            f"| {row['key']} | {row['ground']} | {hidden} | {n} | {row['same']} | {np.sum(np.abs(z) < 2)} of {z.size} "
            f"| {z[np.argmax(np.abs(z))]:+.1f} |"
        )
    good = [r for r in rows if "failed" not in r]
    same, jumps = sum(r["same"] for r in good), sum(len(r["heights"]) for r in good)
    print(f"\nOne height: {same} of {jumps} jumps to the last digit.")
    for apart, words in ((False, ""), (True, ", something hidden in the camera")):
        z = scores([r for r in good if r["camera"] is apart])
        if z.size:
            inside = int(np.sum(np.abs(z) < 2))
            low, high = interval(inside, z.size)
            print(
                f"Truth within 2 sigma{words}: {inside} of {z.size}, {inside / z.size:.1%} ({low:.1%} to {high:.1%})."
            )


def scores(rows: Sequence[Row]) -> Any:
    """(measured - true) / sigma of all jumps that have a height."""
    z = np.array([h["z"] for r in rows for h in r["heights"]], float)
    return z[np.isfinite(z)]


def badness(row: Row) -> float:
    """Less for a worse one."""
    if "failed" in row:
        return -np.inf
    return (
        row["same"] / len(row["heights"])
        + float(np.mean(np.abs(scores([row])) < 2))
        - 1e3 * (row["same"] < len(row["heights"]))
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
