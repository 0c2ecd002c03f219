"""A matplotlib figure as the <svg> of a page: in the page's ink, with titles and links on its points."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from jumpvision.report.style import ACCENT, GREEN, KINDS, MEASURED, MODEL, QUIET, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PX_PER_INCH, MIN_PX_PER_INCH = 100, 75  # of a figure: its letters of 9 pt are 12 px high, and 9 px on a small screen
MAX_MARKS = 800  # of a line: a page has about as many pixels across
INK = "#010203"  # no figure draws in it
OWN = {
    INK: "currentColor",
    "#000000": "currentColor",
    MEASURED: "var(--measured)",
    MODEL: "var(--model)",
    GREEN: "var(--green)",
    ACCENT: "var(--accent)",
    QUIET: "var(--soft)",
    KINDS["sine"].color: "var(--amber)",
    KINDS["custom"].color: "var(--sky)",
}
RC: dict[Any, Any] = {
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("axes.facecolor", "figure.facecolor"), "none"),
    "svg.fonttype": "none",  # letters stay letters: found, selected and read aloud
    "path.simplify_threshold": 0.3,  # px
}


class Drawn(NamedTuple):
    """A figure of a page: its <svg>, what stands above it, and a note."""

    svg: str
    caption: str = ""
    note: str = ""


def drawing(label: str, draw: Callable[..., Figure], *data: object, links: Mapping[str, str] | None = None) -> str:
    """Return the <svg> of a drawing function's figure in the house style.

    label: what the figure shows, for who cannot see it; its ids follow from it, so each figure of a page has its own.
    links: address of each experiment's page, for the points that `label_points` has named.
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out = io.StringIO()
    with styled() as Figure, matplotlib.rc_context({**RC, "svg.hashsalt": label}):
        figure = draw(*data, Figure)
        for axis in figure.axes:
            for line in axis.lines:
                line.set_markevery(max(1, -(-np.size(line.get_xdata()) // MAX_MARKS)))
            for points in axis.collections:
                points.set_visible(points.get_visible() or any(points.get_urls()))
        width = figure.get_size_inches()[0]
        canvas: Any = FigureCanvasSVG(figure)
        canvas.print_svg(out, metadata={"Date": None})  # savefig draws twice
    root = ElementTree.fromstring(out.getvalue())
    _strip(root)
    _name_points(root, links or {})
    _share_looks(root)
    _join_marks(root)
    size = f"width:{PX_PER_INCH * width:.0f}px;min-width:{MIN_PX_PER_INCH * width:.0f}px"
    role = "img" if root.find(".//a") is None else "group"  # what an image holds cannot be reached
    root.attrib = {"viewBox": root.attrib["viewBox"], "style": size, "role": role, "aria-label": label}
    text = ElementTree.tostring(root, encoding="unicode")
    for fixed, own in OWN.items():
        text = text.replace(fixed.lower(), own)
    return text


def _strip(root: ElementTree.Element) -> None:
    """Remove what a page does not need: namespaces, metadata, white space, ids without use, digits beyond 0.1 pt."""
    for parent in root.iter():
        for child in list(parent):
            if child.tag.endswith(("metadata", "style")):
                parent.remove(child)
    asked = {x for e in root.iter() for v in e.attrib.values() for x in re.findall(r"#([\w-]+)", v)}
    for e in root.iter():
        e.tag = e.tag.rpartition("}")[2]
        e.attrib = {k.rpartition("}")[2]: v for k, v in e.attrib.items() if k != "id" or v in asked}
        e.text, e.tail = (x if x and x.strip() else None for x in (e.text, e.tail))
        for k in {"d", "x", "y", "style", "transform"} & set(e.attrib):
            digits = 1 if k in "dxy" and "id" not in e.attrib else 2  # marks, which have ids, are small
            value = re.sub(rf"(\.\d{{{digits}}})\d+", r"\1", e.attrib[k])
            value = re.sub(r"\s*([MLQCz]|$)\s*", r"\1", value) if k == "d" else value
            e.attrib[k] = re.sub(r"([;:]) ", r"\1", value.replace("; font-family: 'DejaVu Sans'", ""))
        if e.get("transform", "").startswith("rotate(-0 "):
            del e.attrib["transform"]


def _name_points(root: ElementTree.Element, links: Mapping[str, str]) -> None:
    """Make of each address "NAME: values" that matplotlib wrote a title, with a link to the page of NAME."""
    for e in list(root.iter("a")):
        title = e.attrib["href"]
        page = links.get(title.partition(": ")[0])
        e.tag = "a" if page else "g"
        link = {"href": page, "tabindex": "-1"} if page else {}  # by the keyboard the table's links are reached
        e.attrib = {"class": "point", **link}
        for inner in e.iter():
            inner.attrib.pop("style", None)
        e.insert(0, ElementTree.Element("title"))
        e[0].text = title


def _share_looks(root: ElementTree.Element) -> None:
    """Write on a group what all its parts have alike."""
    for group in root.iter("g"):
        for look in ("style", "clip-path"):
            value, *others = {e.get(look) for e in group} or {None}
            if len(group) > 1 and value and not others and look not in group.attrib and "opacity" not in value:
                group.set(look, value)
                for e in group:
                    del e.attrib[look]


def _join_marks(root: ElementTree.Element) -> None:
    """Draw the marks of a line as those of one path: a quarter of the text."""
    new = ElementTree.SubElement
    for k, group in enumerate(root.iter("g")):
        shapes = {(e.tag, e.get("href"), e.get("style")) for e in group}
        if len(group) < 3 or len(shapes) > 1 or group[0].tag != "use" or group[0].get("style"):
            continue
        shape, places = group[0].get("href", ""), "L".join(f"{e.get('x')} {e.get('y')}" for e in group)
        group[:] = []
        mark = new(group, "marker", id=f"{shape[1:]}-{k}", overflow="visible", markerUnits="userSpaceOnUse")
        new(mark, "use", href=shape)
        new(group, "path", d=f"M{places}", style=f"fill:none;stroke:none;marker:url({shape}-{k})")
