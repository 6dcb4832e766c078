# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds the compiled library for every platform on any one of them: one wheel each, into wheels/kernels/.

    python kernels/build_kernels.py                        all platforms
    python kernels/build_kernels.py --platform linux-x64   one of them
    python kernels/build_kernels.py --install              this machine's, for the Python that runs this
    python kernels/build_kernels.py --sanitize             its tests with every access to memory watched
    pip wheel ./kernels                                    this machine's, as it is published

The compiler is a package (`ziglang`), fetched once into build/compiler/, so nobody needs a toolchain; only --sanitize
takes the system's. The library is plain C11 without a Python ABI: one wheel serves every Python. What the same sources
have built is not built again.
"""

import argparse
import base64
import hashlib
import importlib.metadata
import os
import platform
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
SOURCES = HERE / "src"
PROJECT = HERE / "pyproject.toml"
WHEELS = ROOT / "wheels" / "kernels"
COMPILER = ROOT / "build" / "compiler"
COMPILER_PINNED = HERE / "compiler.txt"  # its version, and what its files hash to
COMPILER_PACKAGE = COMPILER_PINNED.read_text(encoding="utf-8").split()[0]
PACKAGE = "mocap_autolabel_kernels"
# Contraction would make sums differ from machine to machine.
FLAGS = ("-std=c11", "-O3", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-Wall", "-Wextra", "-Werror")
# Else the library would call itself by where it was built, which differs each time.
NAMED = ("-Wl,-install_name,@rpath/kernels.dylib",)
WATCHED = ("-O1", "-g", "-fPIC", "-lm", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
BEGIN = '# SPDX-License-Identifier: GPL-3.0-or-later\n"""The compiled library of Mocap Autolabel."""\n\n'
FINDING = 'from pathlib import Path\n\nPATH = Path(__file__).parent.with_name("{folder}") / "{library}"\n'
BEFORE_TAG = "Wheel-Version: 1.0\nGenerator: build_kernels\nRoot-Is-Purelib: false\n"


@dataclass(frozen=True)
class Target:
    """A platform: the compiler's name of it, the wheel's tag, the library's file, what else the compiler is told."""

    triple: str
    tag: str
    library: str
    flags: tuple[str, ...] = ()


TARGETS = {
    "linux-x64": Target("x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64", "kernels.so"),
    "windows-x64": Target("x86_64-windows-gnu", "win_amd64", "kernels.dll"),
    "macos-arm64": Target("aarch64-macos.11.0", "macosx_11_0_arm64", "kernels.dylib", NAMED),
    "macos-x64": Target("x86_64-macos.11.0", "macosx_11_0_x86_64", "kernels.dylib", NAMED),
}


def main() -> int:
    """Do what the command line asks for; prints each wheel's path."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--platform", choices=TARGETS, action="append", help="only this platform; may be repeated")
    parser.add_argument("--install", action="store_true", help="put this machine's into the Python that runs this")
    parser.add_argument("--sanitize", action="store_true", help="test a library that watches what it does")
    arguments = parser.parse_args()
    if arguments.sanitize:
        return sanitize()
    if arguments.install:
        return install()
    for name in arguments.platform or TARGETS:
        print(build(name), flush=True)
    return 0


def this_platform() -> str:
    """The name of the platform that this runs on, whether or not a library is built for it."""
    system = {"Linux": "linux", "Windows": "windows", "Darwin": "macos"}.get(platform.system(), platform.system())
    machine = platform.machine().lower()
    return f"{system}-" + {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64"}.get(machine, machine)


def install() -> int:
    """Put this machine's library into the Python that runs this, unless it is there."""
    name = _this_target()
    try:
        have = importlib.metadata.version(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        have = ""
    if have == version():
        return 0
    wheel = build(name)
    _pip("install", "--no-deps", "--force-reinstall", str(wheel))
    print(wheel)
    return 0


def unpack_library(folder: Path) -> str:
    """Put this machine's library into `folder`, where it lies beside other packages; gives its wheel's platform tag."""
    name = _this_target()
    with zipfile.ZipFile(build(name)) as wheel:
        for entry in (entry for entry in wheel.namelist() if ".dist-info/" not in entry):
            wheel.extract(entry, folder)
    return TARGETS[name].tag


def _this_target() -> str:
    name = this_platform()
    if name not in TARGETS:
        sys.exit(f"build_kernels.py: no library is built for {name}; expected one of {', '.join(TARGETS)}")
    return name


def build_wheel(folder: str, *_asked: dict | str | None) -> str:
    """What pip calls: builds this machine's wheel into a folder as the index takes it, and gives its name."""
    return build(_this_target(), Path(folder), version().partition("+")[0]).name


def build_sdist(folder: str, *_asked: dict | None) -> str:
    """What pip calls: packs all that builds the wheel into a folder, and gives the archive's name."""
    number = version().partition("+")[0]
    name, about = f"{PACKAGE}-{number}", _metadata(number).encode()
    with tarfile.open(Path(folder, f"{name}.tar.gz"), "w:gz") as packed:
        entry = tarfile.TarInfo(f"{name}/PKG-INFO")
        entry.size = len(about)
        packed.addfile(entry, BytesIO(about))
        for path in (PROJECT, Path(__file__), COMPILER_PINNED, SOURCES):
            packed.add(path, f"{name}/{path.name}")
    return f"{name}.tar.gz"


def get_requires_for_build_wheel(*_asked: dict | None) -> list[str]:
    """What pip asks for: the compiler."""
    return [COMPILER_PACKAGE]


def build(name: str, folder: Path = WHEELS, number: str = "") -> Path:
    """Build the wheel of a platform, unless the one of these sources is there; gives its path.

    Its version is `number`, else the one that is of these sources alone.
    """
    target = TARGETS[name]
    wheel = folder / f"{PACKAGE}-{number or version()}-py3-none-{target.tag}.whl"
    if wheel.is_file():
        return wheel
    with tempfile.TemporaryDirectory() as scratch:
        library = Path(scratch) / target.library
        compile_library(target, library)
        folder.mkdir(parents=True, exist_ok=True)
        part = wheel.with_suffix(".part")
        pack(part, target, library.read_bytes())
        part.replace(wheel)
    for other in folder.glob(f"{PACKAGE}-*-py3-none-{target.tag}.whl"):
        if other != wheel:
            other.unlink()
    return wheel


def version() -> str:
    """The library's version, and what tells these sources from others, which no package index would take."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    digest = hashlib.sha256("\0".join((*FLAGS, *NAMED, COMPILER_PACKAGE, FINDING)).encode())
    for path in sorted(SOURCES.glob("*.[ch]")):
        digest.update(path.name.encode() + path.read_bytes())
    return f"{project['version']}+{digest.hexdigest()[:12]}"


def compile_library(target: Target, library: Path) -> None:
    """Compile the sources for a target; the compiler's complaints end the build."""
    compiler = _compiler()
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        target.triple,
        "-s",
        *FLAGS,
        *target.flags,
        *_sources(),
    ]
    # What the compiler keeps for the next time belongs to the project, not to its user's home.
    cache = {name: str(ROOT / "build" / "compiled") for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")}
    _compile([*command, "-o", str(library)], os.environ | cache | compiler)


def pack(wheel: Path, target: Target, library: bytes) -> None:
    """Write a wheel with the library; the same library gives the same bytes.

    Each version has a folder of its own: Windows neither removes nor replaces a library that is in use, so in an update
    Blender could put the new one in the place of the old one only after a restart, and does not try again.
    """
    number = wheel.name.split("-")[1]
    info, folder = f"{PACKAGE}-{number}.dist-info", f"{PACKAGE}_{version().partition('+')[2]}"
    start = BEGIN + FINDING.format(folder=folder, library=target.library)
    files = {
        f"{PACKAGE}/__init__.py": start.encode(),
        f"{folder}/{target.library}": library,
        f"{info}/METADATA": _metadata(number).encode(),
        f"{info}/WHEEL": f"{BEFORE_TAG}Tag: py3-none-{target.tag}\n".encode(),
    }
    rows = [f"{name},sha256={_digest(content)},{len(content)}" for name, content in files.items()]
    files[f"{info}/RECORD"] = "\n".join([*rows, f"{info}/RECORD,,", ""]).encode()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)


def _metadata(number: str) -> str:
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    about = {"Metadata-Version": "2.4", "Name": PACKAGE, "Version": number, "Summary": project["description"]}
    about |= {"License-Expression": project["license"], "Requires-Python": project["requires-python"]}
    return "".join(f"{name}: {value}\n" for name, value in about.items())


def sanitize() -> int:
    """Run the tests of the compiled functions with a library that ends them at the first wrong access or overflow."""
    compiler = shutil.which("gcc")
    if compiler is None or platform.system() != "Linux":
        sys.exit("build_kernels.py: --sanitize found no gcc; expected a Linux with its package gcc installed")
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / PACKAGE
        package.mkdir()
        (package / "__init__.py").write_text(f'{BEGIN}PATH = "{package / "watched.so"}"\n', encoding="utf-8")
        flags = [flag for flag in FLAGS if flag != "-O3"]
        _compile([compiler, *flags, *_sources(), *WATCHED, "-o", str(package / "watched.so")], dict(os.environ))
        runtime = [_printed(compiler, f"-print-file-name=lib{name}.so") for name in ("asan", "ubsan")]
        watching = {
            "LD_PRELOAD": ":".join(runtime),
            "ASAN_OPTIONS": "detect_leaks=0",  # Python itself leaks at its end
            "PYTHONMALLOC": "malloc",
            "PYTHONPATH": os.pathsep.join([folder, str(ROOT)]),
        }
        tests = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/core/kernels"]
        return subprocess.run([sys.executable, *tests], check=False, cwd=ROOT, env=os.environ | watching).returncode


def _sources() -> list[str]:
    return [str(path) for path in sorted(SOURCES.glob("*.c"))]


def _compiler() -> dict[str, str]:
    """What has to be in the environment for Python to find the compiler, which is fetched unless it is there."""
    name, _, wanted = COMPILER_PACKAGE.partition("==")
    with suppress(importlib.metadata.PackageNotFoundError):
        if importlib.metadata.version(name) == wanted:
            return {}
    stamp = COMPILER / "fetched"
    found = {"PYTHONPATH": str(COMPILER)}
    if stamp.is_file() and stamp.read_text(encoding="utf-8") == COMPILER_PACKAGE:
        return found
    shutil.rmtree(COMPILER, ignore_errors=True)
    _pip("install", "--target", str(COMPILER), "--require-hashes", "--requirement", str(COMPILER_PINNED))
    stamp.write_text(COMPILER_PACKAGE, encoding="utf-8")
    return found


def _pip(*arguments: str) -> None:
    """Run pip; its complaints end the build."""
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input", "-q"]
    done = subprocess.run([*pip, *arguments], check=False, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode:
        said = done.stderr.strip().splitlines() or ["nothing"]
        sys.exit(f"build_kernels.py: `pip {' '.join(arguments)}` says: {said[-1]}")


def _compile(command: list[str], environment: dict[str, str]) -> None:
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, stdin=subprocess.DEVNULL, env=environment
    )
    if done.returncode:
        sys.exit(f"build_kernels.py: the compiler says: {done.stderr}")


def _printed(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")


if __name__ == "__main__":
    sys.exit(main())
