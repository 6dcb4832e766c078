# SPDX-License-Identifier: GPL-3.0-or-later
"""What the documentation says is true: its Python runs, its command lines exist, its links and tests are there."""

import ast
import json
import re
import shlex
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from addon.cli.parser import build_parser
from addon.core.training.described import described
from addon.io.cameras import read_cameras
from addon.io.layouts import read_layout
from addon.io.markersets import read_markerset
from addon.jobs.models import known_bodies
from scripts.virtual_take import write_virtual_take

ROOT = Path(__file__).resolve().parents[1]
CORE = ROOT / "addon" / "core"
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted(DOCS.rglob("*.md"))]
WRITTEN = [page for page in PAGES if page.name != "CHANGELOG.md" and page.parent != DOCS / "results"]
MOST_WORDS, MOST_IN_A_SENTENCE = 35_000, 30
PARTS = "|".join(path.stem for path in (ROOT / "addon").iterdir() if path.is_dir())
ARCHITECTURE = (DOCS / "architecture.md").read_text(encoding="utf-8")
BLENDERS = {"bpy", "addon_utils", "mathutils", "gpu", "blf", "gpu_extras", "bpy_extras"}


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path, language: str) -> list[tuple[int, str]]:
    """Line and text of the page's code blocks in a language."""
    text = page.read_text(encoding="utf-8")
    found = re.finditer(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return [(text[: match.start()].count("\n") + 1, match[1]) for match in found]


def cases(language: str):
    return [pytest.param(text, id=f"{named(page)}:{line}") for page in PAGES for line, text in blocks(page, language)]


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    """A folder with the files that the snippets name: room.toml and walk.csv, of a virtual person."""
    folder = tmp_path_factory.mktemp("room")
    write_virtual_take(folder, 219, 200, "walk.csv", "room.toml")
    return folder


@pytest.mark.parametrize("snippet", cases("python"))
def test_snippets_run(snippet, room, monkeypatch, capsys):
    monkeypatch.chdir(room)
    exec(compile(snippet, "snippet", "exec"), {"__name__": "snippet"})
    said = capsys.readouterr().out
    shares = [(int(a), int(b)) for a, b in re.findall(r"(\d+) of (\d+) blobs named", said)]
    assert said and all(named > 0.85 * count for named, count in shares)
    precision = re.search(r"precision ([\d.]+)%", said)
    assert precision is None or float(precision[1]) > 99


@pytest.mark.parametrize("text", cases("sh"))
def test_command_lines_are_the_programs(text):
    lines = [line.split(" #")[0] for line in text.splitlines() if line.startswith("mocap-autolabel ")]
    assert lines
    for line in lines:
        assert build_parser().parse_args(shlex.split(line)[1:]).run


VERBS = next(action for action in build_parser()._actions if action.choices).choices


@pytest.mark.parametrize("verb", sorted(VERBS))
def test_the_guide_tells_every_option_that_people_see(verb):
    guide = "\n".join(page.read_text(encoding="utf-8") for page in DOCS.glob("guide/*.md"))
    flags = {flag for action in VERBS[verb]._actions for flag in action.option_strings if flag.startswith("--")}
    assert {flag for flag in flags - {"--help"} if not re.search(rf"`[^`\n]*{flag}\b", guide)} == set()


@pytest.mark.parametrize("text", cases("json") + cases("toml"))
def test_an_example_is_a_marker_set_one_in_words_or_a_calibration(text, tmp_path):
    path = tmp_path / ("leg4.markerset.json" if text.startswith("{") else "example.toml")
    path.write_text(text, encoding="utf-8")
    if path.suffix == ".json":
        assert read_markerset(path).name == json.loads(text)["name"]
    elif "[markers]" in text:
        assert len(described(read_layout(path), known_bodies())) == 6
    else:
        assert read_cameras(path).names == ("cam1",)


def anchors(page: Path) -> set[str]:
    """What a page's headings are called in links."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    bare = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings]
    return {heading.replace(" ", "-") for heading in bare}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_what_a_page_names_is_there(page):
    """Links, files, tests, and names such as `core.blobs.search.find_subject`: of a file of `addon`, and what is in it.

    What a merge leaves where two changes meet is not for readers.
    """
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\((?!https?://)([^)\s]+)\)", text):
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), f"{page.name} links to {link}"
        assert not anchor or anchor in anchors(target), f"{page.name} links to {link}"
    for name in re.findall(r"`((?:tests|scripts|addon|assets|docs)/[\w./]+\.\w+)", text):
        assert (ROOT / name).is_file(), f"{page.name} names {name}"
    for file, function in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text):
        assert f"def {function}(" in (ROOT / file).read_text(encoding="utf-8"), f"{page.name} names {file}::{function}"
    for name in re.findall(rf"`((?:{PARTS})(?:\.\w+)+)\b", text):
        place, rest = ROOT / "addon", name.split(".")
        while rest and (place / rest[0]).is_dir():
            place = place / rest.pop(0)
        file = place / f"{rest.pop(0)}.py" if rest and (place / f"{rest[0]}.py").is_file() else place / "__init__.py"
        assert file.is_file(), f"{page.name} names {name}"
        begun = r"(?:(?:def|class) |from .* import .*\b| {4}(?=\w+,$))?"  # what is defined in it, or handed on
        found = re.search(rf"^{begun}{(*rest, '')[0]}\b", file.read_text(encoding="utf-8"), re.MULTILINE)
        assert found or not rest, f"{page.name} names {name}"
    assert re.findall(r"^(?:<{7}|>{7}|={7}$).*", text, re.MULTILINE) == []


def test_the_papers_are_gone_through_claim_by_claim():
    text = (DOCS / "papers.md").read_text(encoding="utf-8")
    lines = re.findall(r"^\| ([AB]\d+) \| [^|]+ \| ([^|]+) \|$", text, re.MULTILINE)
    assert [line for line, _ in lines] == [f"A{n}" for n in range(1, 35)] + [f"B{n}" for n in range(1, 39)]
    for line, shown in lines:
        assert re.search(r"`tests/[\w/]+\.py::\w+`|\]\(results/", shown), f"{line} has no test and no result"


def sentences(page: Path) -> list[str]:
    """The page's sentences, without code blocks, tables, headings and where links lead."""
    text = re.sub(r"^```.*?^```$|^[|#][^\n]*$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    bare = re.sub(r"\]\([^)]*\)", "]", text)
    return re.split(r"(?<=[.!?:])\s|\n\n|\n *(?:[-*]|\d+\.) ", bare)


@pytest.mark.parametrize("page", [ROOT / "README.md", *sorted(DOCS.glob("guide/*.md"))], ids=named)
def test_sentences_for_users_are_short_and_hand_written_pages_not_too_long(page):
    assert sum(len(one.read_text(encoding="utf-8").split()) for one in WRITTEN) <= MOST_WORDS
    assert [one for one in sentences(page) if len(one.split()) > MOST_IN_A_SENTENCE] == []


def imports_of(path: Path) -> set[tuple[str, ...]]:
    """What a file of `addon` imports, anywhere: modules of `addon` by their path from there, libraries by name."""
    package, found = path.relative_to(ROOT / "addon").parts[:-1], set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {(name.name.split(".")[0],) for name in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module.split(".")[0],))
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1]
            modules = [node.module.split(".")] if node.module else [[name.name] for name in node.names]
            found |= {(*above, *module) for module in modules}
    return found


def test_the_code_imports_what_the_architecture_allows_of_parts_that_are_there():
    rows = re.findall(r"^\| `(\w+)` \|([^|]*\|[^|]*)\|$", ARCHITECTURE, re.MULTILINE)
    allowed = {part: set(re.findall(r"`(\w+)`", others)) for part, others in rows}
    assert len(allowed) > 10
    for path in sorted((ROOT / "addon").rglob("*.py")):
        part = path.relative_to(ROOT / "addon").with_suffix("").parts[0]
        taken = {"bpy" if name in BLENDERS else name for name, *_ in imports_of(path)}
        assert taken <= allowed.get(part, set()) | set(sys.stdlib_module_names) | {"numpy", part}, path
    known = {path.stem for path in (ROOT / "addon").iterdir() if path.suffix == ".py" or path.is_dir()}
    libraries = {"bpy", "distributed", "lzallright", "olefile", "scipy", "threadpoolctl"}
    assert set(allowed) <= known and set().union(*allowed.values()) <= known | libraries


def test_no_file_imports_itself_by_way_of_others():
    addon, graph = ROOT / "addon", {}
    for path in addon.rglob("*.py"):
        wanted = [addon.joinpath(*module) for module in imports_of(path)]
        files = [one.with_suffix(".py") if not one.is_dir() else one / "__init__.py" for one in wanted]
        graph[path] = [one for one in files if one.exists()]
    assert len(list(TopologicalSorter(graph).static_order())) == len(graph) > 100


def test_every_folder_of_core_has_its_line_in_the_architecture_and_imports_only_those_above():
    table = ARCHITECTURE.partition("### The order of `core`")[2].partition("\n## ")[0]
    order = re.findall(r"^\| `([\w/]+)` \|.+\|$", table, re.MULTILINE)
    there = {path.parent.relative_to(CORE).as_posix() for path in CORE.rglob("*.py") if path.name != "__init__.py"}
    assert sorted(order) == sorted(there)
    for place, folder in enumerate(order):
        for path in sorted((CORE / folder).glob("*.py")):
            targets = [CORE.joinpath(*rest) for part, *rest in imports_of(path) if part == "core"]
            targets = {(one if one.is_dir() else one.parent).relative_to(CORE).as_posix() for one in targets}
            assert targets <= {folder, *order[:place]}, path
