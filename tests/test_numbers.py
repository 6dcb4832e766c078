# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers set by hand in core: each says on its own line what it rests on."""

import ast
import re
from pathlib import Path

import pytest

CORE = Path(__file__).resolve().parents[1] / "addon" / "core"
# physical: unit and source; paper: equation; measured: on which case; learned: by what; memory and format: limits of
# machines and of files.
KINDS = re.compile(r"\b(physical|paper|measured|learned|memory|format)\b")


def count(node: ast.expr | None) -> int:
    """How many numbers a default holds, those in tuples and lists too."""
    if isinstance(node, ast.UnaryOp):
        node = node.operand
    if isinstance(node, ast.Tuple | ast.List):
        return sum(map(count, node.elts))
    return int(isinstance(node, ast.Constant) and type(node.value) in (int, float))


def owed_in(source: str) -> int:
    """Numbers in the fields of a module's classes of which no line says what they rest on."""
    found, lines = 0, source.splitlines()
    for one in ast.walk(ast.parse(source)):
        if not isinstance(one, ast.ClassDef):
            continue
        doc = (ast.get_docstring(one) or "").splitlines()
        for field in (part for part in one.body if isinstance(part, ast.AnnAssign)):
            own = [lines[field.lineno - 1], *(line for line in doc if re.match(rf"\s*{field.target.id}\b", line))]
            if not any(KINDS.search(line) for line in own):
                found += count(field.value)
    return found


@pytest.mark.parametrize(
    ("field", "owed"),
    [
        ("reach: float = 0.5", 1),
        ("reach: float = -0.5  # physical: m, half an arm", 0),
        ("reach: tuple[float, ...] = (0.5, 2)", 2),
        ("often: bool = True", 0),
    ],
)
def test_a_number_must_say_what_it_rests_on(field, owed):
    assert owed_in(f'class Options:\n    """What is tried."""\n\n    {field}\n') == owed


def test_the_line_of_a_docstring_says_it_for_its_own_number_alone():
    doc = '"""What is tried.\n\n    near  measured: half of it loses 2 % of a crowd\n    far   where it ends\n    """'
    assert owed_in(f"class Options:\n    {doc}\n\n    near: float = 0.5\n    far: float = 2.0\n") == 1


def test_no_number_of_core_rests_on_nothing():
    owed = {path.relative_to(CORE).as_posix(): owed_in(path.read_text("utf-8")) for path in sorted(CORE.rglob("*.py"))}
    assert not {path: number for path, number in owed.items() if number}
