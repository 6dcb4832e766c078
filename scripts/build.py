# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds the installable extension, one zip for each platform and Python of a Blender, into dist/.

    python scripts/build.py                                      all of them
    python scripts/build.py --platform linux-x64 --blender 5.1   one of them
    python scripts/build.py --compiled                           with the compiled library, for a site of one's own

Run it in an environment with `bpy` (`.venv` of run.py): Blender's own packager and checker come with it. Wheels are
fetched once into wheels/. NumPy is never among them, because Blender brings its own and extensions share their wheels;
nor is the compiled library unless it is asked for, as Blender's platform takes wheels of the package index only.
"""

import argparse
import importlib.util
import re
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from kernels import build_kernels

MANIFEST = "blender_manifest.toml"
LIBRARIES = ("olefile==0.47", "threadpoolctl==3.8.0")
# The platform tags that each platform's oldest supported system accepts (Blender's own requirements, SciPy's builds).
WHEEL_TAGS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_12_0_arm64",),
    "macos-x64": ("macosx_11_0_x86_64",),
}


# The last release with a wheel for each platform; one wheel serves every Python.
UNPACKERS = dict.fromkeys(WHEEL_TAGS, "lzallright==0.3.0") | {"macos-x64": "lzallright==0.2.6"}
# SciPy's last release for each Python that a Blender runs on.
SCIPY = {"311": "scipy==1.17.1", "313": "scipy==1.18.1", "314": "scipy==1.18.1"}


@dataclass(frozen=True)
class Blender:
    """Blenders that a zip is built for: versions from `first` to before `last` with one Python, and their platforms."""

    python: str
    platforms: tuple[str, ...]
    first: str
    last: str = ""


BLENDERS = {
    "4.5": Blender("311", tuple(WHEEL_TAGS), "4.5.0", "5.1.0"),
    # Blender 5 no longer comes for Macs with Intel processors.
    "5.1": Blender("313", ("linux-x64", "windows-x64", "macos-arm64"), "5.1.0"),
    # Linux distributions build it with a newer Python than blender.org does, whose platform cannot tell the two apart.
    "5.1-python3.14": Blender("314", ("linux-x64",), "5.1.0"),
}


def main() -> int:
    """Build what the command line asks for and print each zip's path."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--platform", choices=WHEEL_TAGS, action="append", help="only this platform; may be repeated")
    parser.add_argument("--blender", choices=BLENDERS, action="append", help="only this Blender; may be repeated")
    parser.add_argument("--compiled", action="store_true", help="with the compiled library, which no index has yet")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the zips (dist)")
    parser.add_argument("--version", help="a version other than the manifest's, for trying updates")
    arguments = parser.parse_args()
    for name in arguments.blender or BLENDERS:
        for platform in BLENDERS[name].platforms:
            if platform in (arguments.platform or WHEEL_TAGS):
                print(build(name, platform, arguments.out, arguments.version, arguments.compiled), flush=True)
    return 0


def for_blender(version: tuple[int, ...], python: str) -> str:
    """Which of BLENDERS a Blender of this version and Python takes; LookupError where no zip is built for it."""
    for name, blender in BLENDERS.items():
        first, last = (tuple(map(int, text.split("."))) for text in (blender.first, blender.last or "999"))
        if first <= version < last and python == blender.python:
            return name
    raise LookupError(f"no zip is built for Blender {'.'.join(map(str, version))} with Python {python}")


def build(name: str, platform: str, out: Path, as_version: str | None = None, compiled: bool = False) -> Path:
    """Build and check the zip for the Blender `name` on `platform`; gives its path in the folder `out`."""
    blender = BLENDERS[name]
    manifest = (ROOT / MANIFEST).read_text(encoding="utf-8")
    if as_version:
        manifest = re.sub(r'(?m)^version = ".*"$', f'version = "{as_version}"', manifest)
    wheels = fetch_wheels(blender.python, platform) + ([build_kernels.build(platform)] if compiled else [])
    out.mkdir(parents=True, exist_ok=True)
    ending = "-compiled" if compiled else ""
    target = out / f"mocap_autolabel-{version(manifest)}-blender{name}-{platform}{ending}.zip"
    with tempfile.TemporaryDirectory() as folder:
        sources = Path(folder) / "sources.zip"
        blender_ext("build", "--source-dir", str(ROOT), "--output-filepath", str(sources))
        pack(target, sources, narrowed(manifest, blender, platform, [path.name for path in wheels]), wheels)
    blender_ext("validate", str(target))
    return target


def version(manifest: str = "") -> str:
    """The version that a manifest's text states; without one, the repository's."""
    return tomllib.loads(manifest or (ROOT / MANIFEST).read_text(encoding="utf-8"))["version"]


def fetch_wheels(python: str, platform: str) -> list[Path]:
    """The wheels for one Python ("313") on one platform, fetched into wheels/ unless they are there."""
    folder = ROOT / "wheels" / f"cp{python}-{platform}"
    wanted = [SCIPY[python], UNPACKERS[platform], *LIBRARIES]
    have = {"{}=={}".format(*path.name.split("-")[:2]): path for path in folder.glob("*.whl")}
    if missing := [requirement for requirement in wanted if requirement not in have]:
        tags = [part for tag in WHEEL_TAGS[platform] for part in ("--platform", tag)]
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-input"]
        target = ["--no-deps", "--only-binary", ":all:", "--python-version", python, *tags]
        subprocess.run([*pip, *target, "--dest", str(folder), *missing], check=True, stdin=subprocess.DEVNULL)
        return fetch_wheels(python, platform)
    return [have[requirement] for requirement in wanted]


def narrowed(manifest: str, blender: Blender, platform: str, wheels: Iterable[str]) -> str:
    """The manifest of one zip: the repository's, with its platform, its Blender versions and its wheels."""
    lines = [f'blender_version_min = "{blender.first}"']
    if blender.last:
        lines.append(f'blender_version_max = "{blender.last}"')
    lines.append(f'platforms = ["{platform}"]')
    lines.append("wheels = [\n" + "".join(f'  "./wheels/{wheel}",\n' for wheel in wheels) + "]")
    text = re.sub(r"(?m)^# scripts/build.py narrows .*\n", "", manifest)
    text = re.sub(r"(?m)^blender_version_min = .*$", lambda _: "\n".join(lines), text)
    return text[: text.index("[build]")].rstrip() + "\n"


def pack(target: Path, sources: Path, manifest: str, wheels: list[Path]) -> None:
    """Write the zip anew from the packed sources, the narrowed manifest and the wheels."""
    with zipfile.ZipFile(sources) as packed, zipfile.ZipFile(target, "w") as archive:
        for entry, content in _entries(packed, manifest, wheels):
            compression = zipfile.ZIP_STORED if entry.endswith(".whl") else zipfile.ZIP_DEFLATED
            # A fixed time makes the same sources give the same bytes.
            archive.writestr(zipfile.ZipInfo(entry), content, compression)


def _entries(packed: zipfile.ZipFile, manifest: str, wheels: list[Path]) -> Iterator[tuple[str, bytes]]:
    yield MANIFEST, manifest.encode()
    for name in sorted(packed.namelist()):
        if name != MANIFEST and not name.endswith("/"):
            yield name, packed.read(name)
    for path in wheels:
        yield f"wheels/{path.name}", path.read_bytes()


def blender_ext(command: str, *arguments: str) -> None:
    """Run Blender's own extension tool, with Blender's own list of tags; its complaints end the build."""
    spec = importlib.util.find_spec("bpy")
    if spec is None:
        sys.exit("build.py: this Python has no bpy module, which brings Blender's packager; use the one in .venv")
    (module,) = spec.submodule_search_locations
    (tool,) = Path(module).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    scripts = tool.parents[3]
    tags = next(scripts.glob("modules/**/extensions/tags.py"))
    done = subprocess.run(
        [sys.executable, str(tool), command, "--valid-tags", str(tags), *arguments],
        check=False,
        capture_output=True,
        text=True,
    )
    if done.returncode or "WARN" in done.stdout.upper():
        sys.exit(f"build.py: Blender's packager says: {done.stdout}{done.stderr}")


if __name__ == "__main__":
    sys.exit(main())
