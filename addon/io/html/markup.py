# SPDX-License-Identifier: GPL-3.0-or-later
"""Elements of HTML and SVG, and how pages look: what is text is escaped, because only `Html` is taken as it is."""

import html
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from ...core.data.errors import InputError
from ..source import open_binary

STYLE = """
:root{color-scheme:light dark;--bg:#fff;--ink:#1a1a1a;--soft:#595959;--line:#d4d4d4;--card:#f4f5f6;--track:#e6e7e8;
--named:#009e73;--doubtful:#d55e00;--filled:#56b4e9;--edited:#cc79a7}
@media(prefers-color-scheme:dark){:root{--bg:#15171a;--ink:#ececec;--soft:#a8adb3;--line:#3d4248;--card:#1f2327;
--track:#30353b;--doubtful:#e8741a}}
*{box-sizing:border-box}
body{margin:0;background:var(--bg);color:var(--ink);font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
main{max-width:1040px;margin:0 auto;padding:20px 16px 48px}
h1{font-size:1.7em;line-height:1.2;margin:.2em 0;overflow-wrap:anywhere}
h2{font-size:1.2em;margin:2em 0 .5em;padding-bottom:.2em;border-bottom:1px solid var(--line)}
h3{font-size:1em;margin:1.2em 0 .4em}
p{margin:.4em 0;max-width:75ch;overflow-wrap:anywhere}
.soft,caption,figcaption,dt{color:var(--soft)}
.soft,figcaption{font-size:.9em}
a{color:inherit}
ul,ol{margin:.4em 0;padding-left:1.3em;overflow-wrap:anywhere}
dl{display:grid;grid-template-columns:max-content 1fr;gap:2px 14px;margin:.6em 0}
dd{margin:0;overflow-wrap:anywhere}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(190px,1fr));gap:10px;margin:1em 0;padding:0;
list-style:none}
.tiles li{background:var(--card);border-radius:8px;padding:10px 14px}
.tiles strong{display:block;font-size:1.6em;line-height:1.25;font-variant-numeric:tabular-nums}
.notes{border-left:4px solid var(--doubtful);background:var(--card);padding:6px 14px;margin:1em 0}
.wide{overflow-x:auto;max-width:100%;margin:.6em 0 1em}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
caption{text-align:left;font-size:.9em;padding-bottom:4px}
th,td{text-align:left;padding:2px 10px 2px 0;vertical-align:top;border-bottom:1px solid var(--line);font-weight:400}
thead th{color:var(--soft);font-size:.9em;vertical-align:bottom}
tbody th{font-weight:600;min-width:5.5em;max-width:16em;overflow-wrap:anywhere}
td{overflow-wrap:anywhere;min-width:3.2em}
.n{text-align:right;white-space:nowrap}
.bar{display:flex;align-items:center;gap:8px;min-width:150px}
.bar svg{flex:1;height:11px;min-width:60px}
.bar span{width:4.6em;text-align:right;white-space:nowrap}
.time{table-layout:fixed}
.time thead th:first-child{width:8.5em}
.time tbody th{white-space:nowrap;min-width:0;overflow:hidden;text-overflow:ellipsis}
.time th,.time td{padding:1px 8px 1px 0;border:0;line-height:1.15;vertical-align:middle;font-size:.85em}
.time td{padding-right:0;min-width:0}
.time svg{display:block;width:100%;height:11px;background:var(--track)}
.axis{display:flex;justify-content:space-between;color:var(--soft)}
.legend{display:flex;flex-wrap:wrap;gap:2px 16px;list-style:none;padding:0;font-size:.9em}
.legend svg{width:14px;height:12px;vertical-align:-1px;margin-right:5px;background:var(--track)}
figure{margin:1em 0;break-inside:avoid}
figcaption{max-width:75ch}
.views{display:grid;grid-template-columns:repeat(auto-fit,minmax(200px,1fr));gap:8px}
.views svg{display:block;width:100%;height:auto;background:var(--card);border-radius:8px}
.moments{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,470px),1fr));gap:4px 26px}
.moments figure{margin:.6em 0}
.moments h3{margin:.4em 0}
svg text{fill:var(--ink);font:11px system-ui,-apple-system,"Segoe UI",Roboto,sans-serif;unicode-bidi:isolate}
svg .small{fill:var(--soft)}
svg .hot{font-weight:700}
.views text{paint-order:stroke;stroke:var(--card);stroke-width:3px;stroke-linejoin:round}
svg .grid{stroke:var(--line);stroke-width:1;fill:none}
svg .bone{stroke:var(--soft);stroke-width:3;stroke-linecap:round;opacity:.45}
svg .dot{fill:var(--named)}
svg .other{stroke:var(--soft);stroke-width:1.2;fill:none}
svg .doubt{fill:var(--doubtful)}
svg .ring{fill:none;stroke:var(--doubtful);stroke-width:2}
svg .body{fill:none;stroke:var(--ink);stroke-width:1.2;stroke-dasharray:2 2}
svg .block{fill:var(--named)}
svg .rest{fill:var(--track)}
.s path{fill:none;shape-rendering:crispEdges}
.named{stroke:var(--named)}.doubtful{stroke:var(--doubtful)}.filled{stroke:var(--filled)}.edited{stroke:var(--edited)}
.gap{stroke:var(--track)}
.s .base{stroke-width:6.6}.s .doubtful.base{stroke-width:10}.s .filled.base{stroke-width:3.4}.s .also{stroke-width:2}
footer{margin-top:3em;color:var(--soft);font-size:.9em}
@media(max-width:520px){body{font-size:14px}dl{grid-template-columns:1fr}dt{margin-top:4px}
.time thead th:first-child{width:6em}th,td{padding-right:7px}}
@media print{@page{size:A4;margin:14mm}
:root{color-scheme:light;--bg:#fff;--ink:#000;--soft:#444;--line:#bbb;--card:#f4f5f6;--track:#e6e7e8;
--doubtful:#d55e00}
body{font-size:10pt}main{max-width:none;padding:0}*{print-color-adjust:exact;-webkit-print-color-adjust:exact}
h2,h3{break-after:avoid}tr,figure,.tiles li{break-inside:avoid}thead{display:table-header-group}
.wide{overflow:visible}.moments{grid-template-columns:1fr 1fr}
.moments .views{grid-template-columns:1fr 1fr;gap:4px}}
"""


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
        element("style", Html(STYLE)),
    )
    page = element("html", element("head", *head), "\n", element("body", element("main", *content)), lang="en")
    Path(path).write_text(f"<!DOCTYPE html>\n{page}\n", encoding="utf-8", newline="\n")


def is_page(path: Path) -> bool:
    """Whether a file is a page that was written here."""
    mark = element("meta", name="generator", content=GENERATOR).encode()
    try:
        with open_binary(path) as file:
            return mark in file.read(1000)
    except (InputError, OSError):
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
