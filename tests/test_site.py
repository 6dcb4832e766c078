# SPDX-License-Identifier: GPL-3.0-or-later
"""The site is built without a warning, its pages of results are those of the results, and quoted figures are theirs."""

import importlib.util
import re
import subprocess
import sys

import pytest

from scripts import results
from scripts.site_pages import file_page
from tests.test_docs import ROOT, WRITTEN, named

QUOTED = re.compile(r"(\S+(?: %| mm| px| s| ms)?)\s?<!-- (\w+): ([^>]+?) -->")


def test_the_site_is_built_without_a_warning(tmp_path):
    if importlib.util.find_spec("mkdocs") is None or importlib.util.find_spec("mkdocstrings") is None:
        pytest.skip("mkdocs-material and mkdocstrings are not installed")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    site = tmp_path / "site"
    assert "addon/core/blobs" in (site / "files" / "index.html").read_text(encoding="utf-8")
    assert "read_cameras" in (site / "api" / "index.html").read_text(encoding="utf-8")


def test_pages_and_plots_of_results_are_made_of_the_results():
    there = {path.name: path.read_text(encoding="utf-8") for path in results.OUT.glob("*.md")}
    assert there == results.pages(), "run python scripts/results.py"
    images = {path.name: path.read_text(encoding="utf-8") for path in (results.OUT / "images").glob("*.svg")}
    drawn = results.plots()
    assert images.keys() == drawn.keys()
    for name, (_, digest) in drawn.items():
        assert digest in images[name], f"{name}: run python scripts/results.py"


@pytest.mark.parametrize("name", [name for name in results.names() if name != results.ABLATION])
def test_a_result_says_where_it_is_from(name):
    data = results.read(name)
    assert data["page"] in results.PAGES
    assert data["command"].startswith("python ")
    assert re.search(r"\d{4}-\d\d-\d\d.* commit [0-9a-f]{10}", data["measured_at"])
    assert len({table["key"] for table in data["tables"]}) == len(data["tables"]) > 0
    for table in data["tables"]:
        assert len(set(table["columns"])) == len(table["columns"])
        assert table["rows"]
        assert all(len(row) == len(table["columns"]) for row in table["rows"])
    assert results.dump(data) == (results.RESULTS / f"{name}.json").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", WRITTEN, ids=named)
def test_quoted_figures_are_measured(page):
    for figure, name, words in QUOTED.findall(page.read_text(encoding="utf-8")):
        keys = [key.strip() for key in re.split(r"\\?\|", words)]  # in a table a bar is escaped
        assert is_in(figure, results.quoted(name, keys)), f"{named(page)}: {figure}"


def is_in(figure: str, cell: str) -> bool:
    """Whether a quoted figure is one of a cell's, or a number of it as exactly as it is quoted."""
    if re.search(rf"(?<![\d.,]){re.escape(figure)}(?![\d.,])", cell):
        return True
    number, said = results.figure(figure), results.figure(cell)
    exact = re.search(r"\.(\d+)", figure)
    return None not in (number, said) and round(said, len(exact[1]) if exact else 0) == number


def test_a_quoted_figure_that_was_not_measured_is_seen():
    assert is_in("99.78 %", results.quoted("real_blobs", ["methods", "bvh", "precision"]))
    assert is_in("99.8 %", "99.78 %")
    assert not is_in("99.9 %", "99.78 %")
    assert not is_in("9.78 %", "99.78 %")
    with pytest.raises(LookupError):
        results.quoted("real_blobs", ["methods", "fit", "precision"])


@pytest.mark.parametrize("page", WRITTEN, ids=named)
def test_percentages_say_where_they_are_from(page):
    """By the mark of a result, or, of somebody else's, by a link in the same line."""
    text = re.sub(r"```.*?```|`[^`\n]+`|\$[^$\n]+\$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for match in re.finditer(r"\d\.\d+ %", text):
        rest = text[match.end() :].partition("\n")[0]
        assert re.match(r"\s?<!-- \w+: |.*\]\(https://", rest), f"{named(page)}: {match[0]} without its result"


def test_every_file_of_the_code_is_listed_with_what_it_does():
    lines = re.findall(r"^\| `(\w+\.py)` \| (.*) \|$", file_page(), re.MULTILINE)
    assert len(lines) > 300
    assert all(line for _, line in lines)


def test_the_output_of_a_command_becomes_a_result(tmp_path, monkeypatch):
    monkeypatch.setattr(results, "RESULTS", tmp_path)
    results.take("new", "Words.\n\n| a | b |\n| --- | ---: |\n| 1 | 99.5 % |\n")
    (table,) = results.read("new")["tables"]
    assert (table["columns"], table["rows"]) == (["a", "b"], [["1", "99.5 %"]])
    results.take("new", "| a | b |\n| --- | --- |\n| 1 | 99.7 % |\n")
    assert results.quoted("new", [table["key"], "1", "b"]) == "99.7 %"


def test_the_ablation_has_a_page_of_its_own():
    case = {"takes": 2, "refused": 0, "there": 9, "recall": 99.5, "wrong_percent": 0.25, "seconds": 3.5}
    same = {"right": [0, 0.1], "wrong": [0.01, 0.02], "seconds": [3.5, 3.4], "refused": [0, 0]}
    data = {
        "command": "python -m tests.accuracy.ablation",
        "version": "abc",
        "measured_at": "2026-01-31, commit 0123456789",
        "note": "Before a change.",
        "cases": {"points frame": case},
        "variants": {
            "without undo": {"points frame": same},
            "without links": {"points frame": {**same, "right": [-0.5, 0.1]}},
        },
    }
    page = results.ablation_page(data)
    assert "| points frame | 2 | 0 | 9 | 99.5 | 0.25 | 3.5 |" in page
    assert "| `without links` | points frame | -0.500 ± 0.100 | +0.010 ± 0.020 | 3.5 → 3.4 | 0 → 0 |" in page
    assert "| `without undo` | 1 | points frame | +0.000 ± 0.100 |" in page.partition("change no case")[2]
    assert "2026-01-31, commit 0123456789" in page
    assert "Before a change." in page


@pytest.mark.parametrize(
    ("command", "there"),
    [
        ("python -m tests.accuracy.ablation", True),
        ("python -m tests.fuzz --count 5", True),
        ("python -m tests.accuracy.partial --results DIR --show table4", False),
        ("python -m tests.accuracy.actors walkers-2", False),
        ("python -m tests.accuracy.gone", False),
        ("python -m pytest tests/io/test_rooms.py", True),
    ],
)
def test_a_page_says_which_commands_are_history(command, there):
    assert results.is_in_the_code(command) == there
