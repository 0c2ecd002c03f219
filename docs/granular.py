"""Make the figures and the table of numbers of docs/granular.md anew: `python docs/granular.py` (about a minute)."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from PIL import Image

from jumpvision.thesis.figures.sweeps import picture
from jumpvision.thesis.studies.study import Call, run, studies

PAGE = Path(__file__).with_name("granular.md")
IMAGES = PAGE.parent / "images"
BEGIN, END = "<!-- numbers: made by python docs/granular.py -->\n", "<!-- end of numbers -->"


def table(found: dict[str, list[dict[str, Any]]]) -> str:
    """The rows of all analyses as a markdown table."""
    head = "| analysis | quantity | thesis | RK4 | ours |\n|---|---|---|---|---|\n"
    return head + "".join(
        f"| `{name}` | {r['quantity']} | {r['thesis']} | {r['RK4']} | {r['ours']} |\n"
        for name, rows in found.items()
        for r in rows
    )


def main() -> None:
    found = {}
    for name in [n for n, s in studies("granular").items() if not (s.of_campaign or s.any_axes)]:
        data, found[name] = run(Call("granular", {}, name, say=lambda text: None))
        with Image.open(io.BytesIO(picture(data))) as full:  # few colours: a third of the size
            full.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(
                IMAGES / f"granular-{name}.png", optimize=True
            )
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    PAGE.write_text(before + BEGIN + table(found) + END + rest.partition(END)[2], encoding="utf-8")


if __name__ == "__main__":
    main()
