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
def test_quoted_figures_are_measured_and_percentages_say_where_they_are_from(page):
    """By the mark of a result, or, of somebody else's, by a link in the same line."""
    text = page.read_text(encoding="utf-8")
    for figure, name, words in QUOTED.findall(text):
        keys = [key.strip() for key in re.split(r"\\?\|", words)]  # in a table a bar is escaped
        assert is_in(figure, results.quoted(name, keys)), f"{named(page)}: {figure}"
    text = re.sub(r"```.*?```|`[^`\n]+`|\$[^$\n]+\$", "", text, flags=re.DOTALL)
    for match in re.finditer(r"\d\.\d+ %", text):
        rest = text[match.end() :].partition("\n")[0]
        assert re.match(r"\s?<!-- \w+: |.*\]\(https://", rest), f"{named(page)}: {match[0]} without its result"
    assert is_in("99.8 %", "99.78 %") and not is_in("99.9 %", "99.78 %") and not is_in("9.78 %", "99.78 %")


def is_in(figure: str, cell: str) -> bool:
    """Whether a quoted figure is one of a cell's, or a number of it as exactly as it is quoted."""
    number, said = results.figure(figure), results.figure(cell)
    exact = re.search(r"\.(\d+)", figure)
    rounded = None not in (number, said) and round(said, len(exact[1]) if exact else 0) == number
    return rounded or bool(re.search(rf"(?<![\d.,]){re.escape(figure)}(?![\d.,])", cell))


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


def test_a_page_says_which_commands_are_history():
    partial = "python -m tests.accuracy.partial --results DIR --show table4"
    there = "python -m tests.accuracy.ablation", "python -m tests.fuzz --count 5", partial
    assert all(map(results.is_in_the_code, (*there, "python -m pytest tests/io/test_rooms.py")))
    gone = "python -m tests.accuracy.actors walkers-2", "python -m tests.accuracy.gone"
    assert not any(map(results.is_in_the_code, gone))
