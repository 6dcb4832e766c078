# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of all sources: names, numbers set by hand, sentences of errors, files that are opened, stages switched off."""

import ast
import inspect
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name

import pytest

from tests.accuracy.switches import CORE, STAGES

TESTS = Path(__file__).parent
ADDON = TESTS.resolve().parent / "addon"
TEXTS = {path.relative_to(ADDON).as_posix(): path.read_text("utf-8") for path in sorted(ADDON.rglob("*.py"))}
TREES = {name: ast.parse(text) for name, text in TEXTS.items()}
# What every module of its kind has: the classes that Blender registers, a verb's help, a reader's "expected …".
OF_EVERY_MODULE = {"DESCRIPTION", "KIND", "EXPECTED"}


def names_defined(tree: ast.Module) -> set[str]:
    """Classes and constants at the top of a file."""
    found = {node.name for node in tree.body if isinstance(node, ast.ClassDef)}
    for node in tree.body:
        for target in node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]:
            names = [one.id for one in getattr(target, "elts", [target]) if isinstance(one, ast.Name)]
            found |= {name for name in names if name.isupper()}
    return found


def test_no_name_is_given_twice():
    places = defaultdict(list)
    for file, tree in TREES.items():
        for name in names_defined(tree) - OF_EVERY_MODULE:
            places[name].append(file)
    assert len(places) > 500
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


OVER_EVERYTHING = re.compile(
    r"""\b(?:shared_data|DATA|PEOPLE|MCGILL|ROOM)\b.*\.(?:rglob\(|iterdir\(|glob\(["'][^"']*\*/)"""
)


def test_no_test_goes_through_all_of_the_recorded_data():
    texts = {path: path.read_text("utf-8") for path in TESTS.rglob("*.py") if path != Path(__file__)}
    assert len(texts) > 100
    assert [path.name for path, text in texts.items() if OVER_EVERYTHING.search(text)] == []


# What a number set by hand rests on. physical: unit and source; paper: equation; measured: on which case; learned: by
# what; memory and format: limits of machines and of files.
KINDS = re.compile(r"\b(physical|paper|measured|learned|memory|format)\b")


def count(node: ast.expr | None) -> int:
    """How many numbers a default holds, those in tuples and lists too."""
    if isinstance(node, ast.UnaryOp):
        node = node.operand
    if isinstance(node, ast.Tuple | ast.List):
        return sum(map(count, node.elts))
    return int(isinstance(node, ast.Constant) and type(node.value) in (int, float))


def owed_in(source: str) -> int:
    """Numbers in the fields of a module's classes whose lines do not say what they rest on."""
    found, lines = 0, source.splitlines()
    for one in (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)):
        for field in (part for part in one.body if isinstance(part, ast.AnnAssign)):
            if not KINDS.search(lines[field.lineno - 1]):
                found += count(field.value)
    return found


def test_no_number_of_core_rests_on_nothing():
    fields = "# where it ends\n    far: tuple[float, ...] = (-2.0, 3)\n    wide: int = 4  # paper: equation 2"
    assert owed_in(f"class OPTIONS:\n    {fields}\n") == 2, "those of `far`"
    owed = {name: owed_in(text) for name, text in TEXTS.items() if name.startswith("core/")}
    assert not {name: number for name, number in owed.items() if number}


ERRORS = {"InputError", "JobError", "UserError"}
PASSED_ON = {"message", "words"}  # what a function hands on as it was given


def written(node: ast.AST) -> str | None:
    """The text of a literal, with the source of what is put into it in braces; None where it is none."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        parts = [one.value if isinstance(one, ast.Constant) else f"{{{ast.unparse(one.value)}}}" for one in node.values]
        return "".join(parts)
    return None


def called(node: ast.Call) -> str:
    return getattr(node.func, "id", getattr(node.func, "attr", ""))


def texts_of(trees: list[ast.AST]) -> dict[str, set[str]]:
    """What literals each name is given anywhere in the sources."""
    found = defaultdict(set)
    for node in (node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Assign)):
        if (text := written(node.value)) is not None:
            for target in node.targets:
                found[ast.unparse(target)].add(text)
    return found


def sentences(tree: ast.AST) -> Iterator[ast.Call]:
    """The calls that make an error, or hand its sentence to a function of the file that does nothing but make it."""
    makers = set(ERRORS)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.name in ("fail", "_error", "_refuse"):
            own = [call for call in ast.walk(node) if isinstance(call, ast.Call) and called(call) in ERRORS]
            if own and not any("; expected" in (written(call.args[0]) or "") for call in own):
                makers.add(node.name)
    return (node for node in ast.walk(tree) if isinstance(node, ast.Call) and called(node) in makers and node.args)


def says_what_was_expected(node: ast.AST, texts: dict[str, set[str]]) -> bool:
    if isinstance(node, ast.IfExp):
        return "; expected" in ast.unparse(node)
    if isinstance(node, ast.Attribute):
        return node.attr in PASSED_ON
    if isinstance(node, ast.Name) and node.id in PASSED_ON:
        return True
    known = texts.get(node.id, set()) if isinstance(node, ast.Name) else {written(node)}
    for text in known:
        wrong, _, wanted = (text or "").partition("; ")
        wanted = wanted.strip("{}") if wanted.startswith("{") else wanted
        if not wrong or not any("expected" in one for one in texts.get(wanted, {wanted})):
            return False
    return bool(known)


def test_every_sentence_says_what_was_expected():
    texts = texts_of(list(TREES.values()))
    calls = [(name, call) for name, tree in TREES.items() for call in sentences(tree)]
    lacking = [one for one in calls if not says_what_was_expected(one[1].args[0], texts)]
    assert len(calls) > 300
    assert [f"{name}:{call.lineno}: {ast.unparse(call)[:120]}" for name, call in lacking] == []
    odd = [*sentences(ast.parse('raise InputError("is odd")\nraise JobError(f"is {odd}; it is", path)'))]
    assert not any(says_what_was_expected(call.args[0], {}) for call in odd)


@pytest.mark.parametrize(("where", "instead"), [item for stage in STAGES.values() for item in stage.items()])
def test_what_stands_in_the_place_of_a_stage_takes_what_the_stage_does(where, instead):
    given = inspect.signature(resolve_name(f"{CORE}.{where}")).parameters.values()
    by_name = {one.name: one.default for one in given if one.kind is one.KEYWORD_ONLY}
    by_place = [one.name for one in given if one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD)]
    inspect.signature(instead).bind(*by_place, **by_name)


OPENS = {"open", "read_text", "write_text", "TextIOWrapper", "fdopen"}


def openings() -> Iterator[tuple[str, str, str, set[str], str]]:
    """Each call that opens a file, or seems to: where, what is called, the file's mode, the words given, the call."""
    others = [*(ADDON.parent / "scripts").glob("*.py"), *ADDON.parent.glob("*.py")]
    for file, tree in (TREES | {str(path): ast.parse(path.read_text("utf-8")) for path in others}).items():
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call) and called(node) in OPENS):
            if ast.unparse(call.func) not in ("os.open", "Image.open"):
                modes = [word.value for word in call.keywords if word.arg == "mode"]
                modes += call.args[0 if isinstance(call.func, ast.Attribute) else 1 :][:1]
                mode = str(modes[0].value) if modes and isinstance(modes[0], ast.Constant) else "r"
                yield file, called(call), mode, {word.arg for word in call.keywords}, ast.unparse(call)


def test_texts_are_opened_with_their_encoding_and_written_with_the_same_line_ends_everywhere():
    """Windows takes other ones where none is said, and the same take gives other bytes."""
    found = list(openings())
    assert len(found) > 30
    plain = [one for one in found if one[1] != "open" or "b" not in one[2]]
    # Methods of ours that have the same names are called with what they read.
    ours = re.compile(r"(^|[^.\w])read_text\(")
    assert [one for one in plain if "encoding" not in one[3] and not ours.search(one[4])] == []
    writing = [one for one in plain if one[1] == "write_text" or (one[1] == "open" and set(one[2]) & set("wax"))]
    writing = [one for one in writing if one[0] in TREES and not re.fullmatch(r"cli/\w+\.py", one[0])]
    assert [one for one in writing if "newline" not in one[3]] == []


def test_every_source_states_its_licence():
    licence = "# SPDX-License-Identifier: GPL-3.0-or-later\n"
    sources = TEXTS | {"__init__.py": (ADDON.parent / "__init__.py").read_text("utf-8")}
    assert [name for name, text in sources.items() if not text.startswith(licence)] == []
