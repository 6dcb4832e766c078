#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets everything up and runs it: `python3 run.py demo` or `python3 run.py test`.

  demo [ARG...]           labels the project's own take; figures are printed, the scene and a picture go to demo-out/
  test [--quick] [ARG...] lint and all tests; ARGs go to pytest (for example: -k cameras). With --quick in one Python,
                          without the slow ones and those of a real Blender: minutes, for every change.

Needs nothing but Python 3.13 or 3.11 (any Python from 3.8 on may start this script), git and the package index.
The compiled library is built for this machine once; where that cannot be, NumPy does its work.
The first run installs into .venv, which takes minutes because Blender itself comes as a Python module.
"""

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent
WINDOWS = os.name == "nt"
# Blender comes as a module for these two only: 5.2 LTS for the first, 4.5 LTS for the second.
PYTHONS = ("3.13", "3.11")
STAMP = "mocap-autolabel.installed"
# Every package with its version and what its files hash to, so that any two installations are the same.
PINNED = "requirements.txt"
REAL_BLENDER = ROOT.parent / "shared" / "tools" / "real-blender"
# Every file of tests in one process, so that what its tests share is made once.
SIDE_BY_SIDE = ("-n", str(min(os.cpu_count() or 1, 8)), "--dist", "loadfile")
# For every change: one Python, and no test that takes long (tests/conftest.py says which) or wants a whole Blender.
QUICK, NOT_SLOW = "--quick", "not slow and not real_blender"
# The second is there for its Blender. Its core is run by the tests of jobs, command line and Blender, so the core's
# own tests need not take their time twice.
NOT_IN_THE_SECOND_PYTHON = ("tests/accuracy", "tests/benchmarks", "tests/core")


def main(argv):
    commands = {"demo": demo, "test": test}
    if not argv or argv[0] not in commands:
        print(__doc__.strip())
        return 0 if argv and argv[0] in ("-h", "--help") else 2
    os.chdir(str(ROOT))
    found = {version: find_python(version) for version in PYTHONS}
    if not any(found.values()):
        running = "{}.{}".format(*sys.version_info[:2])
        say(
            "Python 3.13 or 3.11 is needed and neither was found (this is Python " + running + "). Install one from "
            "python.org, your system's packages (with its venv package), `pyenv install 3.13` or "
            "`uv python install 3.13`, then run this again."
        )
        return 1
    return commands[argv[0]](found, argv[1:])


def demo(found, extra):
    python = install(".venv", *best(found))
    if python is None:
        return 1
    bring_kernels(python)
    compile_sources(python)
    out = [] if any(arg.split("=")[0] == "--out" for arg in extra) else ["--out", "demo-out", "--overwrite"]
    return call([str(python.parent / "mocap-autolabel"), "demo", "--progress", *out, *extra])


def test(found, extra):
    quick = QUICK in extra
    extra = [arg for arg in extra if arg != QUICK]
    version, interpreter = best(found)
    real_blender = None if quick else start_real_blender()
    python = install(".venv", version, interpreter)
    if python is None:
        return 1
    bring_kernels(python)
    compile_sources(python)

    failed = []
    say("Lint")
    checks = [["ruff", "check", "."], ["ruff", "format", "--check", "."], *([] if quick else [["mypy"]])]
    if any(call([python, "-m", *check]) for check in checks):
        failed.append("lint")

    other = next((v for v in PYTHONS if v != version), None)
    if quick:
        extra = ["-m", NOT_SLOW, *extra]
    elif found[other]:
        second = install(".venv-" + other, other, found[other])
        if second is not None:
            bring_kernels(second)
            compile_sources(second)
        say("Tests on Python " + other)
        ignored = ["--ignore=" + folder for folder in NOT_IN_THE_SECOND_PYTHON]
        # 5 is pytest's word for "nothing selected", which narrow arguments may well mean here.
        if second is None or call(
            [second, "-m", "pytest", "-q", "-m", "not real_blender", *SIDE_BY_SIDE, *ignored, *extra], second
        ) not in (0, 5):
            failed.append("the tests on Python " + other)
    else:
        say("Tests on Python " + other + " are skipped: no such Python was found")

    finish_real_blender(real_blender)
    if failed:
        say("Failed so far: " + " and ".join(failed) + ", see above")
    say("Tests on Python " + version)
    status = call([python, "-m", "pytest", *SIDE_BY_SIDE, *extra], python)
    return status or (1 if failed else 0)


def best(found):
    return next((version, found[version]) for version in PYTHONS if found[version])


def find_python(version):
    """The command of a Python of this version that can make environments, or None."""
    pyenv = Path(os.environ.get("PYENV_ROOT", "~/.pyenv")).expanduser() / "versions"
    candidates = [[sys.executable], [shutil.which("python" + version)]]
    candidates += [[str(path)] for path in sorted(pyenv.glob(version + ".*/bin/python"), reverse=True)]
    if WINDOWS and shutil.which("py"):
        candidates.append(["py", "-" + version])
    if shutil.which("uv"):
        candidates.append([output(["uv", "python", "find", "--no-project", version])])
    probe = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
    return next((c for c in candidates if c[0] and output([*c, "-c", probe]) == version), None)


def install(folder, version, interpreter):
    """Brings the environment in `folder` up to date; gives its Python, or None, the reason printed."""
    python = ROOT / folder / ("Scripts/python.exe" if WINDOWS else "bin/python")
    stamp = ROOT / folder / STAMP
    facts = [(ROOT / name).read_bytes() for name in (PINNED, "pyproject.toml", "setup.py", "blender_manifest.toml")]
    state = hashlib.sha256(b"\0".join([version.encode(), str(ROOT).encode(), *facts])).hexdigest()
    if stamp.exists() and stamp.read_text(encoding="utf-8") == state:
        return python

    say("Installing into " + folder + " for Python " + version + " (minutes the first time)")
    usable = output([str(python), "-c", "import sys, pip; print('%d.%d' % sys.version_info[:2])"]) == version
    if not usable and call([*interpreter, "-m", "venv", "--clear", folder]):
        return None
    pip = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-input", "--retries", "8"]
    if all(call([*pip, "--require-hashes", "--requirement", PINNED]) for _ in range(3)):
        say("The installation failed three times, see above: is the package index within reach?")
        return None
    if call([*pip, "--no-deps", "--no-build-isolation", "--editable", "."]):
        return None
    if call([python, "-c", "import bpy"]):
        say(
            "Blender's module was installed but does not start, see above: it may lack system libraries (on Debian "
            "and Ubuntu: apt install libegl1 libgl1 libsm6 libxi6 libxkbcommon0 libxrender1 libxxf86vm1)"
        )
        return None
    stamp.write_text(state, encoding="utf-8")
    return python


def bring_kernels(python):
    """Puts the compiled library into an environment; where it cannot be had, NumPy does its work."""
    if call([python, "kernels/build_kernels.py", "--install"]):
        say("The compiled library could not be built, see above: NumPy does its work, which takes longer")


def compile_sources(python):
    """Compiles the sources once, as pip does with all that it copies: these are only linked to."""
    call([python, "-m", "compileall", "-q", "addon"])


def start_real_blender():
    """Begins to install a whole Blender with a window for the package tests, where a tool for that lies beside us."""
    if os.environ.get("MOCAP_BLENDER") or shutil.which("blender"):
        return None
    if not REAL_BLENDER.exists() or WINDOWS or os.geteuid() != 0:
        return None
    say("Installing a Blender with a window beside this (minutes the first time)")
    return subprocess.Popen([str(REAL_BLENDER), "install"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)


def finish_real_blender(process):
    if process is None:
        return
    version = process.communicate()[0].strip().split("\n")[-1]
    say(
        "Real Blender: "
        + (version if process.returncode == 0 else "its installation failed, its tests will be skipped")
    )


def output(command):
    """What a command prints, or nothing when it cannot be run."""
    try:
        done = subprocess.run(
            command, check=False, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
    except OSError:
        return ""
    return done.stdout.decode(errors="replace").strip() if done.returncode == 0 else ""


def call(command, python=None):
    """Runs a command to its end; with the programs of `python`'s environment first on PATH when given."""
    env = dict(os.environ, PYTHONUNBUFFERED="1")
    if python:
        env["PATH"] = str(python.parent) + os.pathsep + env.get("PATH", "")
    return subprocess.call([str(part) for part in command], stdin=subprocess.DEVNULL, env=env)


def say(text):
    print("== " + text, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
