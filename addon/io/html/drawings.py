# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of a take as SVG: its markers over time, how lengths are spread, and the person at one moment."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.review.overview import CELL_STATES, GAP_CELL, Moment, TakeOverview
from ...core.review.suspects import runs
from .markup import Html, element, percent

# How pictures are laid out; by looking at them.
VIEW = 300  # of a picture of a person, and the `margin` around whom, in its units
VIEW_HEIGHT = 320
VIEW_MARGIN = 30
NAMED_BESIDE = 4  # markers beside the doubtful ones that are called by their names
SHOWN_LETTERS = 18  # of a name in a picture; the whole name is in its title
LETTER_UNITS = 6.4  # the width of a letter, in units, for keeping names apart


# From the most to the least serious, for what only some frames of a column are.
SERIOUS = ("doubtful", "gap", "edited", "filled", "named")


def bar(share: float | None, of: str) -> Html:
    """A share as a bar with its number; `of` says of what it is, to whom cannot see it. None is shown as nothing."""
    if share is None:
        return Html("–")
    width = round(100 * min(max(share, 0.0), 1.0), 2)
    shown = element(
        "svg",
        element("rect", class_="rest", width=100, height=10),
        element("rect", class_="block", width=width, height=10),
        viewBox="0 0 100 10",
        preserveAspectRatio="none",
        role="img",
        aria_label=f"{of}: {percent(share)}",
    )
    return element("div", shown, element("span", percent(share)), class_="bar")


def time_strips(overview: TakeOverview) -> list[Html]:
    """A strip a marker: what most frames of a column are, and below it the most serious that some of them are."""
    cells = overview.cells
    counts = cells.values[: cells.used].astype(int)
    most = counts.argmax(axis=2)
    order = [CELL_STATES.index(state) for state in SERIOUS]
    there = counts[:, :, order] > 0
    worst = np.array(order)[there.argmax(axis=2)]
    also = np.where(worst != most, worst, -1)
    totals = counts.sum(axis=0)
    return [
        _strip(most[:, index], also[:, index], totals[index], name)
        for index, name in enumerate(overview.subject.markers)
    ]


def _strip(most: np.ndarray, also: np.ndarray, totals: np.ndarray, name: str) -> Html:
    paths = []
    for state, word in enumerate(CELL_STATES):
        base, below = runs(most == state), runs(also == state)
        if base and state != GAP_CELL:
            paths.append(element("path", class_=f"base {word}", d="".join(f"M{a} 5h{b - a}" for a, b in base)))
        if below:
            paths.append(element("path", class_=f"also {word}", d="".join(f"M{a} 9h{b - a}" for a, b in below)))
    paths.sort(key=lambda path: "also" in path)
    whole = max(int(totals.sum()), 1)
    shares = ", ".join(f"{word} {percent(n / whole)}" for word, n in zip(CELL_STATES, totals, strict=True) if n)
    size = f"0 0 {len(most)} 10"
    label = f"{name}: {shares}"
    return element("svg", *paths, class_="s", viewBox=size, preserveAspectRatio="none", role="img", aria_label=label)


def strip_legend(states: Sequence[str]) -> Html:
    """What the colours of strips stand for."""
    words = {
        "named": "named",
        "doubtful": "named, doubtful",
        "gap": "gap: not found",
        "filled": "filled, not measured",
        "edited": "corrected by hand",
    }

    def swatch(state: str) -> Html:
        path = element("path", class_=f"base {state}", d="M0 5h10")
        return element("svg", path, class_="s", viewBox="0 0 10 10", preserveAspectRatio="none", aria_hidden="true")

    return element("ul", *(element("li", swatch(state), words[state]) for state in states), class_="legend")


def moment_views(moment: Moment, names: Sequence[str], parents: Sequence[int]) -> Html:
    """The person at a moment from the front and from the right: doubtful markers ringed, those beside them named."""
    ahead = np.array([*moment.heading, 0.0])
    left = np.array([-ahead[1], ahead[0], 0.0])
    who = ", ".join(names[index] for index in moment.doubtful)
    title = f"Frame {moment.frame}: {who} and the markers beside, "
    shown = [
        _view(moment, names, parents, left, title + "from the front", "from the front"),
        _view(moment, names, parents, ahead, title + "from the right", "from the right"),
    ]
    return element("div", *shown, class_="views")


def _view(
    moment: Moment, names: Sequence[str], parents: Sequence[int], across: np.ndarray, title: str, words: str
) -> Html:
    drawn = _Canvas.of(moment, across)
    parts: list[Html | None] = [drawn.floor()]
    for joint, parent in enumerate(parents[: len(moment.joints)]):
        if parent >= 0:
            parts.append(drawn.line(moment.joints[parent], moment.joints[joint], "bone"))
    parts += [drawn.cross(place) for place in moment.others]
    doubtful = list(moment.doubtful)
    plain = [index for index in range(len(names)) if index not in doubtful]
    parts += [drawn.circle(moment.markers[index], "dot", 3.2) for index in plain]
    taken: list[tuple[float, float, float]] = []
    for index in doubtful:
        parts.append(drawn.line(moment.markers[index], moment.expected[index], "body"))
        parts.append(drawn.circle(moment.expected[index], "body", 5))
        parts.append(drawn.circle(moment.markers[index], "doubt", 3.6))
        parts.append(drawn.circle(moment.markers[index], "ring", 9))
    parts.append(drawn.circle(moment.asked, "ring", 9))
    for index in doubtful:
        shown = moment.markers[index] if np.isfinite(moment.markers[index]).all() else moment.expected[index]
        parts.append(drawn.name(shown, names[index], "hot", taken, 11))
    for index in _beside(moment):
        parts.append(drawn.name(moment.markers[index], names[index], "small", taken, 6))
    parts.append(element("text", words, x=10, y=18, class_="small"))
    size = f"0 0 {VIEW} {VIEW_HEIGHT}"
    kept = [part for part in parts if part is not None]
    return element("svg", element("title", title), *kept, viewBox=size, role="img")


def _beside(moment: Moment) -> list[int]:
    """The markers nearest to what is doubtful, the nearest first."""
    doubtful = list(moment.doubtful)
    about = np.concatenate([moment.markers[doubtful], moment.expected[doubtful], moment.asked[None]])
    about = about[np.isfinite(about).all(axis=1)]
    known = [i for i in np.flatnonzero(np.isfinite(moment.markers).all(axis=1)).tolist() if i not in moment.doubtful]
    if not len(about) or not known:
        return []
    off = np.linalg.norm(moment.markers[known][:, None] - about[None], axis=2).min(axis=1)
    return [known[place] for place in np.argsort(off)[:NAMED_BESIDE]]


@dataclass(frozen=True, eq=False)
class _Canvas:
    """A view along a horizontal direction: metres `across` go to the right, z goes up."""

    across: np.ndarray
    middle: np.ndarray
    scale: float

    @classmethod
    def of(cls, moment: Moment, across: np.ndarray) -> "_Canvas":
        doubtful = list(moment.doubtful)
        shown = np.concatenate([moment.markers, moment.joints, moment.expected[doubtful], moment.asked[None]])
        shown = shown[np.isfinite(shown).all(axis=1)]
        flat = np.column_stack([shown @ across, shown[:, 2]]) if len(shown) else np.zeros((1, 2))
        low, high = flat.min(axis=0), flat.max(axis=0)
        room = np.array([VIEW, VIEW_HEIGHT]) - 2.0 * VIEW_MARGIN
        scale = float((room / np.maximum(high - low, 0.3)).min())
        return cls(across, (low + high) / 2, scale)

    def at(self, place: np.ndarray) -> tuple[float, float] | None:
        """Where a place (3,) m lies; None where it is not known or outside."""
        flat = np.array([place @ self.across, place[2]])
        if not np.isfinite(flat).all():
            return None
        x, y = (flat - self.middle) * self.scale
        x, y = round(VIEW / 2 + float(x), 1), round(VIEW_HEIGHT / 2 - float(y), 1)
        inside = 0 <= x <= VIEW and 0 <= y <= VIEW_HEIGHT
        return (x, y) if inside else None

    def floor(self) -> Html | None:
        y = round(VIEW_HEIGHT / 2 + float(self.middle[1]) * self.scale, 1)
        return element("path", class_="grid", d=f"M10 {y}H{VIEW - 10}") if 0 < y < VIEW_HEIGHT else None

    def line(self, one: np.ndarray, other: np.ndarray, kind: str) -> Html | None:
        a, b = self.at(one), self.at(other)
        return None if a is None or b is None else element("path", class_=kind, d=f"M{a[0]} {a[1]}L{b[0]} {b[1]}")

    def circle(self, place: np.ndarray, kind: str, radius: float) -> Html | None:
        at = self.at(place)
        return None if at is None else element("circle", class_=kind, cx=at[0], cy=at[1], r=radius)

    def cross(self, place: np.ndarray) -> Html | None:
        at = self.at(place)
        return None if at is None else element("path", class_="other", d=f"M{at[0] - 2.5} {at[1]}h5m-2.5-2.5v5")

    def name(self, place: np.ndarray, name: str, kind: str, taken: list, away: float) -> Html | None:
        """A name to the right of its marker, a line higher or lower where one is there already; none without room."""
        at = self.at(place)
        if at is None:
            return None
        short = name if len(name) <= SHOWN_LETTERS else name[: SHOWN_LETTERS - 1] + "…"
        wide = LETTER_UNITS * len(short) + 2
        left = round(min(at[0] + away, VIEW - 2 - wide), 1)
        for base in (at[1] + 4, at[1] - 9, at[1] + 17):
            if not any(abs(base - y) < 12 and left < right and x < left + wide for x, right, y in taken):
                taken.append((left, left + wide, base))
                whole = element("title", name) if short != name else None
                return element("text", short, whole, x=left, y=round(base, 1), class_=kind)
        return None
