# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure 5 and others, drawn from results; needs matplotlib, which nothing else does."""

from pathlib import Path

import numpy as np

from .report import PAPER_FA, PAPER_FO
from .results import LEFT_OUT, Results, over
from .scores import Score
from .studies import HIDDEN, TARGETS

LEAST = 1e-3  # per cent: what is none at all is drawn there
SHADES = ("#2f2a6b", "#2b6ca3", "#2a9d8f", "#e0a030", "#c8423b")
LINES = {"paper": ("#c8423b", "s"), "turn": ("#e0a030", "^"), "ours": ("#2b6ca3", "o")}


def draw(results: Results, folder: Path) -> list[Path]:
    """Draws all figures into the folder; gives their files."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for name, make in (("trade-off", trade_off), ("asked-and-got", asked_and_got), ("ghosts-and-noise", disturbed)):
        figure = make(results, plt)
        figure.tight_layout()
        made.append(folder / f"partial-{name}.png")
        figure.savefig(made[-1], dpi=100, metadata={"Software": None})
        plt.close(figure)
    return made


def trade_off(results: Results, plt):
    """Figure 5: a line for each number of hidden markers, a dot for each target; ours by the confidence in between."""
    panels = [("the paper, as printed", None, None)]
    panels += [(column.title, column, counts) for column, counts in results.with_study("grid")]
    across = -(-len(panels) // 2)
    figure, axes = plt.subplots(2, across, figsize=(4.2 * across, 7.6), sharex=True, sharey=True, squeeze=False)
    for axis, (title, column, counts) in zip(axes.flat, panels, strict=False):
        for at, (hide, shade) in enumerate(zip(HIDDEN, SHADES, strict=True)):
            if counts is None:
                assigned, occluded = np.array(PAPER_FA[at]), np.array(PAPER_FO[at])
            else:
                dots = [Score.of(counts[str(hide)][str(t)]) for t in TARGETS if str(t) in counts[str(hide)]]
                assigned = 100 * np.array([dot.false_assignments for dot in dots])
                occluded = 100 * np.array([dot.false_occlusions for dot in dots])
            swept = results.pooled(column, "curve") if column else None
            style = "o" if swept else "o-"
            axis.plot(np.maximum(assigned, LEAST), occluded, style, color=shade, ms=4, label=f"{hide} hidden")
            if swept:
                given, wrong, declared, missed = (np.array(row, dtype=float) for row in swept[str(hide)])
                some = given > 0
                line = 100 * (wrong / np.maximum(given, 1))[some], 100 * (missed / np.maximum(declared, 1))[some]
                axis.plot(np.maximum(line[0], LEAST), line[1], "-", color=shade, lw=1)
        axis.set(xscale="log", title=title)
        axis.grid(alpha=0.3)
    for axis in list(axes.flat)[len(panels) :]:
        axis.set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel(f"false assignments, % ({LEAST:g}: none)")
    for axis in axes[:, 0]:
        axis.set_ylabel("false occlusions, %")
    axes.flat[0].legend(fontsize=8)
    return figure


def asked_and_got(results: Results, plt):
    """Wrong labels allowed against those measured; the band goes from the least to the most over hidden markers."""
    figure, axis = plt.subplots(figsize=(6.4, 5.2))
    ends = np.array([1e-3, 10.0])
    axis.plot(ends, ends, "k:", lw=1, label="as asked")
    for column, counts in results.with_study("grid"):
        shade, dot = LINES[column.method]
        texts = sorted(next(iter(counts.values())), key=float)
        allowed = [100 * (1 - float(text)) for text in texts]
        pooled = [100 * over(counts, float(text)).false_assignments for text in texts]
        each = np.array(
            [[100 * Score.of(by_target[text]).false_assignments for by_target in counts.values()] for text in texts]
        )
        left_out = column.people == LEFT_OUT
        axis.plot(allowed, np.maximum(pooled, LEAST), dot + ("-" if left_out else "--"), color=shade, ms=5,
                  mfc=shade if left_out else "white", label=column.title)  # fmt: skip
        if left_out:
            axis.fill_between(allowed, *(np.maximum(edge, LEAST) for edge in (each.min(1), each.max(1))), color=shade,
                              alpha=0.12, lw=0)  # fmt: skip
    axis.set(xscale="log", yscale="log", xlabel="wrong labels allowed (1 − target), %",
             ylabel=f"wrong labels measured, % ({LEAST:g}: none)")  # fmt: skip
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8)
    return figure


def disturbed(results: Results, plt):
    """False assignments and recall against ghosts and noise, at 99.9 %, people left out."""
    figure, axes = plt.subplots(2, 2, figsize=(10, 7), sharex="col")
    for row, (study, title, scale) in enumerate((("ghosts", "ghosts", 1), ("noise", "noise, mm", 1000))):
        wrong, right = axes[0, row], axes[1, row]
        for column, counts in results.with_study(study):
            if column.people != LEFT_OUT:
                continue
            shade, dot = LINES[column.method]
            scores = [Score.of(by_target["0.999"]) for by_target in counts.values() if "0.999" in by_target]
            at = [scale * float(condition) for condition in counts][: len(scores)]
            wrong.plot(at, [100 * found.false_assignments for found in scores], dot + "-", color=shade,
                       label=column.title)  # fmt: skip
            right.plot(at, [100 * found.recall for found in scores], dot + "-", color=shade)
        wrong.set_yscale("symlog", linthresh=0.1)
        wrong.set(ylabel="false assignments, %", ylim=(0, 100))
        right.set(xlabel=title, ylabel="recall, %", ylim=(0, 101))
        for axis in (wrong, right):
            axis.grid(alpha=0.3)
    if axes[0, 0].lines:
        axes[0, 0].legend(fontsize=8)
    return figure
