# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages as a browser reads them, and as XML: what every page of ours must be."""

import re
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser
from pathlib import Path

EMPTY = {"meta", "br", "hr"}


class Elements(HTMLParser):
    """What a browser makes of a page: its elements with their attributes, and its text."""

    def __init__(self, text: str):
        super().__init__()
        self.found, self.open, self.said = [], [], []
        self.feed(text)
        self.close()
        self.words = " ".join(" ".join(self.said).split())

    def handle_starttag(self, tag, attributes):
        self.found.append((tag, dict(attributes)))
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert tag in EMPTY or self.open.pop() == tag

    def handle_data(self, text):
        self.said.append(text)

    def of(self, tag: str) -> list[dict]:
        return [attributes for name, attributes in self.found if name == tag]


def read(text: str | Path) -> Elements:
    """The page as a browser and as XML has it; it is sound, accessible, and asks for nothing from elsewhere."""
    if isinstance(text, Path):
        text = text.read_text(encoding="utf-8")
    ElementTree.fromstring(text)
    page = Elements(text)
    assert page.open == []
    tags = {tag for tag, _ in page.found}
    assert not {"script", "img", "iframe", "link", "object", "use", "image", "base"} & tags
    assert not [name for _, attributes in page.found for name in attributes if name.startswith("on") or name == "src"]
    assert not re.search(r"https?:|//|url\(|@import|javascript:", re.sub(r"<!DOCTYPE[^>]*>", "", text))
    assert any(each.get("content", "").startswith("default-src 'none'") for each in page.of("meta"))
    assert page.of("html") == [{"lang": "en"}]
    assert len(page.of("h1")) == 1
    assert len(page.of("h2")) > 1
    for drawn in ElementTree.fromstring(text).iter("svg"):
        assert drawn.get("aria-hidden") or drawn.get("aria-label") or drawn.find("title") is not None
    assert all(each.get("scope") for each in page.of("th"))
    return page
