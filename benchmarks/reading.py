"""How easy the guides read: Flesch reading ease of their prose, `python -m benchmarks.reading [FILE ...]`.

206.835 - 1.015 words a sentence - 84.6 syllables a word (Flesch 1948): 60 to 70 is plain English, below 50 hard. Only a
full stop, ! and ? end a sentence, and so do a paragraph and a list's item. Tables, blocks of code, headings and targets
of links are left out; a name in code counts as a word of two syllables, a number as no word.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
GUIDES = (
    "README", "docs/tutorial", "docs/bring_your_own_data", "docs/velocity_fields", "docs/any_simulator",
    "docs/workbench", "docs/glossary", "docs/lessons",
)  # fmt: skip
ALONE = ("docs/glossary",)  # a table of words: its cells are its prose
VOWELS = re.compile(r"[aeiouy]+")


def sentences(text: str, cells: bool = False) -> list[str]:
    """Sentences of a page of Markdown. cells: those of tables too. A list's item and a cell end a sentence."""
    text = re.sub(r"^```.*?^```|<!--.*?-->", "\n\n", text, flags=re.S | re.M)
    lines = []
    for line in text.splitlines():
        if re.match(r"\s*\|", line):
            lines += (
                [f"\n\n{c}\n\n" for c in line.split("|")] if cells and not re.match(r"\s*\|[-|: ]+$", line) else [""]
            )
        elif not line.startswith("#"):
            lines.append(re.sub(r"^\s*(?:[-*>]|\d+\.)\s+", "\n\n", line))
    text = "\n".join(lines)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]*`", "model", text)
    parts = re.split(r"(?<=[.!?])[\"')*]*\s+|\n\s*\n", text)
    return [p for p in parts if len(words(p)) > 1]


def words(sentence: str) -> list[str]:
    return [w for w in re.findall(r"[A-Za-zÀ-ÿ]+(?:'[a-z]+)?", sentence) if len(w) > 1 or w in ("a", "A", "I")]


def syllables(word: str) -> int:
    """Groups of vowels, a silent e and the -ed of most pasts left out."""
    w = word.lower().removesuffix("'s")
    n = len(VOWELS.findall(w))
    if n > 1 and re.search(r"[^aeiouyl]e$|[aeiouy]le$|[^aeiouytd]ed$|[^aeiouycgsxzlh]es$|[aeiouy]les$|[^cs]hes$", w):
        n -= 1
    return max(n, 1)


def ease(text: str, cells: bool = False) -> float:
    said = [words(s) for s in sentences(text, cells)]
    every = [w for s in said for w in s]
    return 206.835 - 1.015 * len(every) / len(said) - 84.6 * sum(map(syllables, every)) / len(every)


def of_guide(name: str) -> float:
    return ease((ROOT / f"{name}.md").read_text(encoding="utf-8"), name in ALONE)


def main(*files: str) -> None:
    """A row a guide, hardest first; of named files their hardest sentences too."""
    if not files:
        print("| guide | Flesch reading ease |\n|---|---|")
        for value, name in sorted((of_guide(n), n) for n in GUIDES):
            print(f"| {name} | {value:.0f} |")
    for file in files:
        text, cells = Path(file).read_text(encoding="utf-8"), file.removesuffix(".md") in ALONE
        print(f"\n{file}: {ease(text, cells):.0f}\n")
        for value, s in sorted((ease(s), " ".join(s.split())) for s in sentences(text, cells))[:12]:
            print(f"{value:6.0f}  {s}")


if __name__ == "__main__":
    main(*sys.argv[1:])
