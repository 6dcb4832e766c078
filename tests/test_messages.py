# SPDX-License-Identifier: GPL-3.0-or-later
"""Every sentence that a user may have to mend something by says what is wrong and what was expected."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ADDON = Path(__file__).resolve().parents[1] / "addon"
ERRORS = {"InputError", "JobError", "UserError"}
PASSED_ON = {"message", "words"}  # what a function hands on as it was given


def written(node: ast.AST) -> str | None:
    """The text of a literal, with the source of what is put into it in braces; None where it is none."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        parts = node.values
        return "".join(
            part.value if isinstance(part, ast.Constant) else f"{{{ast.unparse(part.value)}}}" for part in parts
        )
    return None


def called(node: ast.Call) -> str:
    return getattr(node.func, "id", getattr(node.func, "attr", ""))


def texts_of(trees: list[ast.AST]) -> dict[str, set[str]]:
    """What literals each name is given anywhere in the sources."""
    found: dict[str, set[str]] = {}
    for node in (node for tree in trees for node in ast.walk(tree)):
        if isinstance(node, ast.Assign) and (text := written(node.value)) is not None:
            for target in node.targets:
                found.setdefault(ast.unparse(target), set()).add(text)
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
        begins = texts.get(wanted, {wanted})
        if not wrong or not any("expected" in one for one in begins):
            return False
    return bool(known)


def lacking(sources: dict[str, str]) -> list[str]:
    """The calls whose sentence does not say what was expected, as `FILE:LINE: CALL`."""
    trees = {name: ast.parse(source) for name, source in sources.items()}
    texts = texts_of(list(trees.values()))
    return [
        f"{name}:{call.lineno}: {ast.unparse(call)[:120]}"
        for name, tree in trees.items()
        for call in sentences(tree)
        if not says_what_was_expected(call.args[0], texts)
    ]


def test_every_sentence_says_what_was_expected():
    sources = {str(path.relative_to(ADDON.parent)): path.read_text("utf-8") for path in sorted(ADDON.rglob("*.py"))}
    assert lacking(sources) == []


@pytest.mark.parametrize(
    "source",
    [
        'raise InputError("is odd")',
        'raise InputError(f"is {odd}; it is", path)',
        'EXPECTED = "an even one"\nraise JobError(f"is odd; {EXPECTED}")',
        'what = "is odd"\nraise errors.InputError(what, path)',
        "def fail(self, message):\n    raise InputError(message)\nreader.fail('is odd')",
    ],
)
def test_sentences_that_do_not_are_found(source):
    assert len(lacking({"a.py": source})) == 1
