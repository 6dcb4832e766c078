# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the pages and plots of docs/results from results/*.json: python scripts/results.py.

A command of tests/accuracy or tests/benchmarks prints tables; so they become the file that README and pages quote:

python -m tests.benchmarks.playback | python scripts/results.py --take playback

The file keeps its title, page and note; tables go by their order. The ablation writes a file of its own shape.
"""

import argparse
import datetime
import hashlib
import json
import re
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results"
OUT = ROOT / "docs" / "results"
ABLATION = "ablation"
PAGES = {
    "from-blobs": "From the blobs of cameras",
    "from-points": "From 3D points",
    "several": "Several people",
    "virtual-occlusions": "The first paper: virtual occlusions",
    "partial-solvers": "The second paper: partial solvers",
    "filling": "Filled gaps",
    "bodies": "The body on the floor, and on rigs",
    "placement-quality": "Marker placement",
    "speed": "Speed",
    "memory": "Memory",
    "robustness": "Broken files and disturbed batches",
}
WORDS = """Every figure of this project is in a file of `results`, one a command, with the command and the version that
it was measured on. These pages and plots are made of those files. Where a page of these docs or the README quotes a
figure, a test holds it against its file. A command that is not in the code any more, of a question that was asked once,
is in the history at the commit beside it. The recorded people are not part of the project; without them the commands of
`tests.accuracy` say so and end.
"""
MADE_BY = """What the cases are is told where they are made: `whole_takes.py` (points, short), `actors.py` (several),
`captures.py` (blobs, curves) and `registry.py`, in `tests/accuracy`.
"""
MADE = "<!-- made by scripts/results.py from results/*.json: change those -->\n"


def read(name: str) -> dict:
    """A file of results."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def names() -> list[str]:
    """The files of results that are there, in the order of their names."""
    return sorted(path.stem for path in RESULTS.glob("*.json"))


def dump(data: dict) -> str:
    """A file's text: a row of a table is a line, so that a change of it is one too."""
    text = json.dumps(data, ensure_ascii=False, indent=1)
    string = r'"(?:[^"\\]|\\.)*"'
    return re.sub(rf"\[\n\s+({string}(?:,\n\s+{string})*)\n\s+\]", _joined, text) + "\n"


def _joined(match: re.Match) -> str:
    return "[" + re.sub(r",\n\s+", ", ", match[1]) + "]"


def pages() -> dict[str, str]:
    """The text of every page, by its name in docs/results."""
    made = {f"{page}.md": _page(page, title) for page, title in PAGES.items()}
    if (RESULTS / f"{ABLATION}.json").exists():
        made[f"{ABLATION}.md"] = ablation_page(read(ABLATION))
    made["index.md"] = _index(made)
    return made


def _page(page: str, title: str) -> str:
    parts = [MADE, f"# {title}\n"]
    own = [(data["order"], name, data) for name in names() if (data := read(name)).get("page") == page]
    for _, name, data in sorted(own, key=lambda part: part[:2]):
        parts += _command(name, data)
    return "\n".join(parts)


def _command(name: str, data: dict) -> list[str]:
    parts = [f"## {data['title']}\n", f"{data['note']}\n"]
    where = "" if is_in_the_code(data["command"]) else " (in the history)"
    parts.append(f"`{data['command']}`{where}, {data['measured_at']}; `results/{name}.json`\n")
    for table in data["tables"]:
        parts += [f"### {table['title']}\n"] if len(data["tables"]) > 1 else []
        parts += [f"{table['note']}\n"] if "note" in table else []
        if "plot" in table:
            parts.append(f"![{table['title']}](images/{name}-{table['key']}.svg)\n")
        parts.append(markdown(table["columns"], table["rows"]))
    return parts


def is_in_the_code(command: str) -> bool:
    """Whether the command of a result can still be called."""
    module = re.match(r"python -m (tests[\w.]+)", command)
    if module is None:
        return True
    place = ROOT.joinpath(*module[1].split("."))
    block = re.search(r"--show ([\w-]+)", command)
    if block is not None:
        return f'"{block[1]}":' in (place / "report.py").read_text(encoding="utf-8")
    file = place.with_suffix(".py")
    return (place / "__main__.py").exists() or (file.exists() and "__main__" in file.read_text(encoding="utf-8"))


def markdown(columns: Sequence[str], rows: Iterable[Sequence]) -> str:
    """A table as Markdown."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in lines)


def _index(made: dict[str, str]) -> str:
    rows = []
    for name in names():
        data = read(name)
        if data.get("page"):
            rows.append([f"[{data['title']}]({data['page']}.md)", f"`{data['command']}`", data["measured_at"]])
    if f"{ABLATION}.md" in made:
        data = read(ABLATION)
        rows.append([f"[What each stage brings]({ABLATION}.md)", f"`{data['command']}`", data["measured_at"]])
    rows.sort()
    return "\n".join([MADE, "# Results\n", WORDS, markdown(["what", "command", "measured"], rows)])


def ablation_page(data: dict) -> str:
    """What each stage and each number brings: the cases, what changes any of them, and what changes none."""
    columns = ["case", "takes", "refused", "markers", "recall, %", "wrong, %", "seconds"]
    keys = ("takes", "refused", "there", "recall", "wrong_percent", "seconds")
    cases = [[case, *(f"{row[key]:g}" for key in keys)] for case, row in sorted(data["cases"].items())]
    rows, without = [], []
    for name, found in sorted(data["variants"].items()):
        some = [[f"`{name}`", case, *_change(row)] for case, row in sorted(found.items()) if matters(row)]
        rows += some
        case = max(found, key=lambda case: abs(found[case]["right"][0]) + abs(found[case]["wrong"][0]))
        without += [] if some else [[f"`{name}`", str(len(found)), case, *_change(found[case])]]
    words = (
        "Differences are in per cent of the markers that are there, with their 95 % intervals, against all stages on.\n"
    )
    return "\n".join([
        MADE,
        "# What each stage brings\n",
        f"`{data['command']}`, {data['measured_at']}; `results/{ABLATION}.json`\n",
        *([f"{data['note']}\n"] if "note" in data else []),
        "## All stages on\n",
        MADE_BY,
        markdown(columns, cases),
        "## Variants that change a case\n",
        words,
        markdown(["variant", "case", "right", "wrong", "seconds", "refused"], rows),
        "## Variants that change no case by more than its interval\n",
        "With the case that differs most. Of few takes intervals are wide, as one take alone may hold all of it.\n",
        markdown(["variant", "cases", "case", "right", "wrong", "seconds", "refused"], without),
    ])  # fmt: skip


def _change(row: dict) -> list[str]:
    shares = [f"{row[key][0]:+.3f} ± {row[key][1]:.3f}" for key in ("right", "wrong")]
    return [*shares, *(f"{row[key][0]:g} → {row[key][1]:g}" for key in ("seconds", "refused"))]


def matters(row: dict) -> bool:
    """Whether a variant's labels differ by more than the interval, or takes are refused that were not."""
    return any(abs(row[key][0]) > row[key][1] for key in ("right", "wrong")) or row["refused"][0] != row["refused"][1]


def plots() -> dict[str, tuple[dict, str]]:
    """Every table that is also drawn, and the digest of it, by the file of its plot in docs/results/images."""
    found = {}
    for name in names():
        for table in read(name).get("tables", []):
            if "plot" in table:
                text = json.dumps([table["plot"], table["columns"], table["rows"]])
                found[f"{name}-{table['key']}.svg"] = table, hashlib.sha256(text.encode()).hexdigest()[:16]
    return found


def draw(table: dict, digest: str, path: Path):
    """A curve for each group of rows, small, with the digest of the table in it."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    asked, columns = table["plot"], table["columns"]
    curves: dict[str, list[tuple[float, float]]] = {}
    for row in table["rows"]:
        cells = dict(zip(columns, row, strict=True))
        group = ", ".join(cells[column] for column in asked.get("by", []))
        for x, column in asked["points"]:
            at, value = figure(cells[x] if isinstance(x, str) else str(x)), figure(cells[column])
            if at is not None and value is not None:
                label = ", ".join(part for part in (group, column if asked.get("name") else "") if part)
                curves.setdefault(label.replace("`", ""), []).append((at, value))
    with mpl.rc_context({"svg.hashsalt": "results", "svg.fonttype": "none", "font.size": 8}):
        drawn = Figure(figsize=(6, 3.2), layout="constrained")
        axes = drawn.subplots()
        for label, points in curves.items():
            axes.plot(*zip(*sorted(points), strict=True), marker=".", label=label)
        axes.set(xlabel=asked["x"], ylabel=asked["y"], **{f"{axis}scale": "log" for axis in asked.get("log", [])})
        axes.grid(alpha=0.3)
        axes.legend(fontsize=6)
        drawn.savefig(path, format="svg", metadata={"Date": None, "Description": digest})


def figure(cell: str) -> float | None:
    """The first number of a cell; nothing of one that has none."""
    found = re.search(r"-?\d[\d,]*\.?\d*", cell)
    return float(found[0].replace(",", "")) if found else None


def quoted(name: str, keys: list[str]) -> str:
    """What a page quotes: of tables a table's key, words of one row, with commas between, and a column; else keys.

    Raises LookupError where that is no one cell.
    """
    data = read(name)
    if "tables" not in data:
        for key in keys:
            data = data[key]
        return str(data)
    key, words, column = keys
    (table,) = [table for table in data["tables"] if table["key"] == key] or [{"columns": [], "rows": []}]
    asked = [word.strip() for word in words.split(",")]
    rows = [row for row in table["rows"] if all(any(word in cell for cell in row) for word in asked)]
    if len(rows) != 1 or column not in table["columns"]:
        raise LookupError(f"results/{name}.json has {len(rows)} rows of {key} with {words}; expected one, and {column}")
    return rows[0][table["columns"].index(column)]


def take(name: str, text: str):
    """Puts the tables of a command's output into a file that is there, or into a new one."""
    path = RESULTS / f"{name}.json"
    data = (
        read(name) if path.exists() else {"title": name, "page": "from-blobs", "order": 99, "command": name, "note": ""}
    )
    old = data.get("tables", [])
    found = re.findall(r"((?:^\|.*\|\n)+)", text, re.MULTILINE)
    tables = []
    for place, block in enumerate(found):
        head, _, *rows = [[cell.strip() for cell in line[1:-1].split("|")] for line in block.splitlines()]
        kept = old[place] if place < len(old) else {"key": f"table{place + 1}", "title": f"Table {place + 1}"}
        tables.append({**kept, "columns": head, "rows": rows})
    data.update(measured_at=now(), tables=tables)
    path.write_text(dump(data), encoding="utf-8", newline="\n")


def now() -> str:
    """Today and the commit at hand, as results say when they were measured."""
    asked = ["git", "rev-parse", "--short=10", "HEAD"]
    commit = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True)
    return f"{datetime.datetime.now(datetime.UTC).date()}, commit {commit.stdout.strip()}"


def write():
    """Writes all pages and plots, and takes away what no results make any more."""
    made, drawn = pages(), plots()
    images = OUT / "images"
    images.mkdir(parents=True, exist_ok=True)
    for path in [*OUT.glob("*.md"), *images.glob("*.svg")]:
        if path.name not in made and path.name not in drawn:
            path.unlink()
    for name, text in made.items():
        (OUT / name).write_text(text, encoding="utf-8", newline="\n")
    for name, (table, digest) in drawn.items():
        path = images / name
        if not path.exists() or digest not in path.read_text(encoding="utf-8"):
            draw(table, digest, path)


def main() -> int:
    """Takes a command's output where that is asked for, then makes the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--take", metavar="NAME", help="results/NAME.json gets the tables of standard input")
    given = parser.parse_args()
    if given.take:
        take(given.take, sys.stdin.read())
    write()
    return 0


if __name__ == "__main__":
    sys.exit(main())
