"""One style for every figure: colour-blind-safe colours, quiet axes, sizes for a page and for print."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import RcKeyType
    from numpy.typing import ArrayLike

NewFigure = Callable[..., "Figure"]  # a figure of a size, as `Figure(figsize=(width, height))` in inches

# Okabe & Ito: told apart by every kind of colour vision
MEASURED, MODEL, ACCENT, GREEN, QUIET = "#0072B2", "#D55E00", "#CC79A7", "#009E73", "#8a8a8a"
MAP, SIGNED = "viridis", "RdBu_r"


class Kind(NamedTuple):
    """Return the colour and the mark of a kind of jump in every figure."""

    color: str
    mark: str


KINDS = {
    "single": Kind(MEASURED, "o"),
    "stutter": Kind(MODEL, "s"),
    "delayed_stutter": Kind(GREEN, "^"),
    "sine": Kind("#E69F00", "v"),
    "custom": Kind("#56B4E9", "P"),
}
FOOT = {"half": "half foot, as filmed", "full": "whole foot"}  # what an added mass or a momentum is of
OTHER = Kind(ACCENT, "D")


def kind_of(name: object) -> Kind:
    """The look of a kind of jump; of any that has none of its own, one and the same."""
    return KINDS.get(str(name), OTHER)


def spoken(name: str) -> str:
    """A name of a file as a person writes it: kinds of jump, parts of one, mechanisms."""
    written = {"pre_load": "preload", "push_off": "push-off", "re_intrusion": "re-intrusion"}
    return written.get(name, name.replace("_", " "))


def label_points(axis: Axes, x: ArrayLike, y: ArrayLike, titles: Sequence[str], area: float = 90.0) -> None:
    """Give each point (n,) a title "NAME: values", which a page shows on it with a link to the page of experiment NAME.

    area: of what is pointed at [pt^2]. In print nothing is drawn.
    """
    if titles:
        points = axis.scatter(x, y, s=area, zorder=9, clip_on=False, visible=False)
        points.set_urls(titles)
        points.set_in_layout(False)


@contextmanager
def styled() -> Iterator[NewFigure]:
    """pyplot-free matplotlib in the house style; gives `matplotlib.figure.Figure`."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(
        {
            "font.size": 9,
            "axes.titlesize": 9.5,
            "axes.titlelocation": "left",
            "axes.titleweight": "bold",
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "grid.alpha": 0.25,
            "grid.linewidth": 0.6,
            "legend.frameon": False,
            "lines.linewidth": 1.4,
            "figure.facecolor": "white",
            "savefig.dpi": 140,
            "image.cmap": MAP,
            "font.family": "DejaVu Sans",
        }
    ):
        yield Figure


COLUMN, PAGE = 89.0, 183.0  # mm, widths of one and two columns
FORMATS = ("pdf", "svg", "png")

RC: dict[RcKeyType, Any] = {
    "font.size": 7,
    "axes.titlesize": 7,
    "axes.labelsize": 7,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 6,
    "figure.titlesize": 7,
    "axes.titleweight": "normal",
    "axes.linewidth": 0.6,
    "axes.grid": False,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "legend.handlelength": 1.6,
    "figure.constrained_layout.w_pad": 0.03,
    "figure.constrained_layout.h_pad": 0.03,
    "font.sans-serif": ["Arial", "Helvetica", "Liberation Sans", "DejaVu Sans"],
    "font.family": "sans-serif",
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "jumpvision",
    "savefig.dpi": 600,
}


@contextmanager
def printed() -> Iterator[NewFigure]:
    """The style for print; gives what makes a figure, at the width of one column or two."""
    import matplotlib

    with styled() as new, matplotlib.rc_context(RC):

        def sized(figsize: tuple[float, float], **more: bool | str) -> Figure:
            # a figure drawn wider than 6.7 inches takes two columns
            width = (PAGE if figsize[0] > 6.7 else COLUMN) / 25.4
            return new(figsize=(width, figsize[1] * width / figsize[0]), **more)

        yield sized


def lettered(figure: Figure) -> Figure:
    """The figure with (a), (b), ... before the titles of its panels, where it has several; colour bars have none."""
    panels = [a for a in figure.axes if a.get_visible() and not hasattr(a, "_colorbar") and a.axison]
    panels = [a for k, a in enumerate(panels) if all(a.bbox.bounds != b.bbox.bounds for b in panels[:k])]  # twins: one
    for letter, axis in zip(ascii_lowercase, panels if len(panels) > 1 else ()):
        axis.set_title(f"({letter}) {axis.get_title(loc='left')}".rstrip(), loc="left")
    return figure


def save(figure: Figure, file: Path) -> None:
    """Write a figure without a date, so that the same data give the same file; texts set in points are held at 7 pt."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_fontsize(min(text.get_fontsize(), 7.0))
    meta = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {"Software": None}}
    file.parent.mkdir(parents=True, exist_ok=True)
    aside = file.with_name(f".{file.name}.tmp")
    try:
        figure.savefig(aside, format=file.suffix[1:], metadata=meta[file.suffix[1:]])
        aside.replace(file)
    finally:
        aside.unlink(missing_ok=True)
