# SPDX-License-Identifier: GPL-3.0-or-later
"""What mkdocs asks when it builds the site: `files.md`, every file of the code by its docstring's first line, is made.

Links of pages to files of the repository, which the site does not have, become words.
"""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
CODE = ("addon", "kernels", "scripts")


def on_files(files, config):
    """What mkdocs calls when it has gathered the files of docs."""
    from mkdocs.structure.files import File

    files.append(File.generated(config, "files.md", content=file_page()))
    return files


def on_page_markdown(markdown, page, **_others):
    """What mkdocs calls for every page's text."""
    folder = (DOCS / page.file.src_uri).parent

    def link(match: re.Match) -> str:
        target = (folder / match[2].partition("#")[0]).resolve()
        return match[0] if target.is_relative_to(DOCS) or not target.exists() else match[1]

    return re.sub(r"(?<!!)\[([^\]]*)\]\((\.\./[^)\s]*)\)", link, markdown)


def file_page() -> str:
    """A table for every folder of the code, a line a file."""
    parts = ["# Files\n\nEvery file of the code by the first line of what it says of itself.\n"]
    for folder in sorted({path.parent for name in CODE for path in (ROOT / name).rglob("*.py")}):
        place = folder.relative_to(ROOT).as_posix()
        own = folder / "__init__.py"
        parts.append(f"## {place}\n")
        parts += [f"{first_line(own)}\n"] if own.exists() else []
        rows = [f"| `{path.name}` | {first_line(path)} |\n" for path in sorted(folder.glob("*.py")) if path != own]
        parts += ["| file | what it does |\n| --- | --- |\n" + "".join(rows)] if rows else []
    return "\n".join(parts)


def first_line(path: Path) -> str:
    """Of a module's docstring."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.partition("\n")[0].replace("|", "\\|")
