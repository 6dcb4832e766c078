# SPDX-License-Identifier: GPL-3.0-or-later
"""Elements of HTML and SVG, and how pages look: what is text is escaped, because only `Html` is taken as it is."""

import html
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from ...core.data.errors import InputError
from ..markersets import ASSETS
from ..source import open_binary, read_text

STYLE = ASSETS / "report.css"  # put into every page
GENERATOR = "Mocap Autolabel"
# Nothing but what is in the file: a second lock, should some text ever come through unescaped.
POLICY = "default-src 'none'; style-src 'unsafe-inline'"
EMPTY_ELEMENTS = {"meta", "br", "hr", "path", "line", "circle", "rect", "polyline", "col"}
# What neither XML nor a page has: control signs, and the two that are no letters.
_NO_LETTERS = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ufffe\uffff]")


class Html(str):
    """Text that is markup already."""

    __slots__ = ()


def escaped(text: object) -> Html:
    """Any text as it may stand in a page; what is no letter, in names of files too, is spelt out or shown as �."""
    if isinstance(text, Html):
        return text
    letters = str(text).encode("utf-8", "backslashreplace").decode("utf-8")
    return Html(html.escape(_NO_LETTERS.sub("\ufffd", letters)))


def element(tag: str, *content: object, **attributes: object) -> Html:
    """An element. Content and attributes that are None are left out; `class_` is `class`, `aria_label` `aria-label`."""
    written = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escaped(value)}"'
        for name, value in attributes.items()
        if value is not None
    )
    if not content and tag in EMPTY_ELEMENTS:
        return Html(f"<{tag}{written}/>")
    return Html(f"<{tag}{written}>{joined_html(content)}</{tag}>")


def joined_html(parts: Iterable[object]) -> Html:
    """Several parts one after the other, those that are None left out."""
    return Html("".join(escaped(part) for part in parts if part is not None))


def name_of(name: object) -> Html:
    """A name out of a file: letters of another direction in it turn nothing round it."""
    return element("bdi", name)


def table(heads: Sequence[object], rows: Iterable[Sequence[object]], caption: str, numbers: Iterable[int] = ()) -> Html:
    """A table whose first column heads its rows; `numbers` are the columns that stand to the right.

    It scrolls by itself where it is wider than the page.
    """
    right = set(numbers)
    kinds = ["n" if column in right else None for column in range(len(heads))]
    top = [element("th", head, scope="col", class_=kind) for head, kind in zip(heads, kinds, strict=True)]
    body = [
        element(
            "tr",
            element("th", row[0], scope="row"),
            *(element("td", cell, class_=kind) for cell, kind in zip(row[1:], kinds[1:], strict=True)),
        )
        for row in rows
    ]
    whole = element(
        "table", element("caption", caption), element("thead", element("tr", *top)), element("tbody", *body)
    )
    return element("div", whole, class_="wide", tabindex="0", role="region", aria_label=caption)


def section(title: str, *content: object) -> Html | None:
    """A part of a page under its heading; None where it has no content."""
    content = tuple(part for part in content if part is not None)
    return element("section", element("h2", title), *content) if content else None


def write_page(path: Path, title: str, content: Iterable[object]):
    """Writes a page whose whole text this is."""
    head = (
        element("meta", charset="utf-8"),
        element("meta", name="generator", content=GENERATOR),
        element("meta", http_equiv="Content-Security-Policy", content=POLICY),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", title),
        element("style", Html(read_text(STYLE, "the style of pages"))),
    )
    page = element("html", element("head", *head), "\n", element("body", element("main", *content)), lang="en")
    Path(path).write_text(f"<!DOCTYPE html>\n{page}\n", encoding="utf-8", newline="\n")


def is_page(path: Path) -> bool:
    """Whether a file is a page that was written here."""
    mark = element("meta", name="generator", content=GENERATOR).encode()
    try:
        with open_binary(path) as file:
            return mark in file.read(1000)
    except InputError:
        return False


def percent(share: float | None) -> str:
    """A share for people: 100 % and 0 % only where it is all or nothing."""
    if share is None or share != share:
        return "–"
    text = f"{100 * share:.1f}"
    if text == "100.0":
        text = "100" if share >= 1 else "99.9"
    if text == "0.0":
        text = "0" if share <= 0 else "<0.1"
    return f"{text} %"


def length(value: float | None) -> str:
    """A length with three digits, – where there is none."""
    if value is None or value != value:
        return "–"
    digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2
    return f"{value:.{digits}f}"
