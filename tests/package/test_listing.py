# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender's extensions platform asks of what it lists, a test a rule or two.

TERMS are its terms of service, HANDBOOK the add-on guidelines of the developer handbook, REVIEW what its moderators go
through, MANUAL Blender's manual. What a manifest may say Blender's own checker knows, which has a test too.
"""

import ast
import hashlib
import re
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest

from scripts import build

from .conftest import FLAVOURS, NOT_SHIPPED

MOST_BYTES = 40_000_000
MANIFEST = tomllib.loads((build.ROOT / build.MANIFEST).read_text(encoding="utf-8"))
SHIPPED = {
    path.relative_to(build.ROOT).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
    for path in [build.ROOT / "__init__.py", *sorted((build.ROOT / "addon").rglob("*.py"))]
    if path.relative_to(build.ROOT).as_posix() not in NOT_SHIPPED
}
THREADS = {"_thread", "concurrent.futures", "multiprocessing", "threading"}
NETWORK = {"asyncio", "ftplib", "http", "requests", "smtplib", "socket", "ssl", "urllib.request", "webbrowser"}
OF_BLENDER = {"blf", "bpy", "bpy_extras", "gpu", "gpu_extras", "mathutils", "numpy"}
OF_WHEELS = {"lzallright", "olefile", "scipy", "threadpoolctl"}
PRODUCTS = re.compile("(?i)blender|vicon|optitrack|motive|qualisys|qtm|natnet|shogun|nexus|maya|rokoko|xsens")


@pytest.fixture(scope="module", params=FLAVOURS, ids="-".join)
def package(request, tmp_path_factory) -> Path:
    """Each zip that can be built of what has been fetched."""
    name, platform = request.param
    pytest.importorskip("bpy", reason="the bpy module, which brings Blender's packager, is not installed")
    if not list((build.ROOT / "wheels" / f"cp{build.BLENDERS[name].python}-{platform}").glob("scipy-*.whl")):
        pytest.skip("its wheels have not been fetched here; scripts/build.py does so")
    return build.build(name, platform, tmp_path_factory.mktemp("listed"))


def imported(tree: ast.Module) -> set[str]:
    """The modules that a source imports by their whole names, with those that they are parts of."""
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and not node.level:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names | {".".join(name.split(".")[:end]) for name in names for end in range(1, name.count(".") + 1)}


def attributes() -> Iterator[tuple[str, str]]:
    """File and source of every attribute that a shipped source uses, such as `sys.path`."""
    for name, tree in SHIPPED.items():
        yield from ((name, ast.unparse(node)) for node in ast.walk(tree) if isinstance(node, ast.Attribute))


def test_it_is_nobody_elses_by_name_and_says_whose_its_parts_are():
    """TERMS 2.1 and 2.4, 1 and 3.8."""
    assert not PRODUCTS.search(f"{MANIFEST['id']} {MANIFEST['name']} {MANIFEST['tagline']}")
    assert not PRODUCTS.search(MANIFEST.get("website", ""))
    assert MANIFEST["license"] == ["SPDX:GPL-3.0-or-later"]
    assert len(MANIFEST["copyright"]) > len(OF_WHEELS)


def test_its_permissions_are_what_the_code_does():
    """TERMS 4.1, HANDBOOK on online access, REVIEW on permissions."""
    networked = [name for name, tree in SHIPPED.items() if imported(tree) & NETWORK]
    needed = {"files"} | ({"network"} if networked else set())
    needed |= {"clipboard" for _, text in attributes() if text.endswith("window_manager.clipboard")}
    assert set(MANIFEST["permissions"]) == needed
    assert networked == [] or {name for name, text in attributes() if text == "bpy.app.online_access"}
    assert [text for _, text in attributes() if text.endswith("ops.wm.url_open")] == []


def test_nothing_is_imported_but_pythons_blenders_and_the_wheels_modules_and_no_thread_is_started():
    """HANDBOOK: self-contained, modules bundled; MANUAL: never Blender's own in a wheel. Threads crash Blender."""
    usual = sys.stdlib_module_names | OF_BLENDER | OF_WHEELS
    for name, modules in ((name, imported(tree)) for name, tree in SHIPPED.items()):
        assert {one.partition(".")[0] for one in modules} <= usual, name
        assert not modules & THREADS, name


def test_blenders_modules_keys_and_add_ons_are_left_alone_and_nothing_is_fetched_or_made_to_run():
    """HANDBOOK: not to interfere, no module search changed; TERMS 3.9 and 5.1; REVIEW: no updater, no `bl_info`."""
    changing = r"sys\.(path|modules)\.(append|extend|insert|update|setdefault)|\b(addon_utils|ensurepip|pip)\b"
    others = r"addon_(en|dis)able|package_(un)?install\w*|keyconfigs\.(?!addon\b)\w+|ops\.script\.reload"
    assert [one for one in attributes() if re.search(f"{changing}|{others}", one[1])] == []
    for name, tree in SHIPPED.items():
        for node in ast.walk(tree):
            assert not (isinstance(node, ast.Call) and ast.unparse(node.func) in ("eval", "exec", "__import__")), name
            if isinstance(node, ast.Assign | ast.AugAssign):
                targets = {ast.unparse(one) for one in getattr(node, "targets", [getattr(node, "target", None)])}
                assert not any(re.match(r"sys\.(path|modules)\b|bl_info$", target) for target in targets), name


def test_its_own_folder_is_only_read():
    """MANUAL on local storage, REVIEW on `__file__`."""
    named = {name: {getattr(node, "id", "") for node in ast.walk(tree)} for name, tree in SHIPPED.items()}
    own = {name for name, words in named.items() if "__file__" in words}
    assert own == {"addon/cli/workers.py", "addon/io/markersets.py", "addon/version.py"}


def test_a_zip_is_small_and_holds_sources_to_read_and_wheels_as_the_package_index_has_them(package):
    """TERMS 3.5 and 3.6, MANUAL: wheels unmodified from the index, of one platform."""
    assert package.stat().st_size < MOST_BYTES
    pinned = (build.ROOT / "requirements.txt").read_text(encoding="utf-8")
    with zipfile.ZipFile(package) as archive:
        names = set(archive.namelist())
        assert {name for name in names if name.endswith(".py")} == set(SHIPPED)
        assert {PurePosixPath(name).suffix for name in names} == {".css", ".py", ".json", ".toml", ".whl", ""}
        digests = {name: hashlib.sha256(archive.read(name)).hexdigest() for name in names if name.endswith(".whl")}
    assert {name.split("/")[1].split("-")[0] for name in digests} == OF_WHEELS
    assert [name for name, digest in digests.items() if f"--hash=sha256:{digest}" not in pinned] == []


@pytest.mark.real_blender
def test_a_real_blender_finds_nothing_wrong_with_it(package, blender_program, tmp_path):
    done = blender_program.run("--background", "--command", "extension", "validate", str(package), home=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Success" in done.stdout
