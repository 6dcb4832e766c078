# SPDX-License-Identifier: GPL-3.0-or-later
"""Broken files guided by what they reach in the code: `python -m tests.fuzzing.guided KIND --seconds S --keep FOLDER`.

It needs the package `atheris` (wheels for Linux), in an environment of your own. The limits and what counts as a fault
are those of `tests.fuzz`, and so are the wounds, beside those of `atheris`. A file that is a fault is kept.
"""

import argparse
import random
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["addon"]):
    from tests import fuzz
    from tests.fuzzing import watched
    from tests.wounds import mutated, rebuilt

MOST_BYTES = 1 << 18  # of a file that is guided


def wounded(kind: str, content: bytes, size: int, seed: int) -> bytes:
    """A file with another wound: of its bytes or its structure, or one of atheris' own."""
    chance = random.Random(seed)
    way = chance.random()
    if way < 0.4:
        return atheris.Mutate(content, size)
    try:
        made = mutated(content, chance) if way < 0.7 or not content else rebuilt(kind, content, chance)
    except (ValueError, RecursionError):  # no structure is left
        made = mutated(content, chance)
    return made[:size]


def guide(kind: str, seconds: float, seed: int, keep: Path):
    """Reads broken files of a kind for so long; ends with status 77 at the first fault, whose file it keeps."""
    keep.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=watched.quick_folder()) as folder:
        with atheris.instrument_imports(include=["addon"]):  # a reader is loaded when it is needed
            bench = fuzz.Bench(kind, Path(folder))
        sound = Path(folder) / "corpus"
        sound.mkdir()
        (sound / "sound").write_bytes(bench.contents[kind])
        watched.limit(watched.MEMORY_MB)

        def one(content: bytes):
            found = bench.attempt(content)
            if found not in (None, "refused"):
                (keep / f"guided-{seed}-{bench.path.name}").write_bytes(content)
                print(f"{kind}: {found}", flush=True)
                raise AssertionError(found)

        words = [f"-max_total_time={seconds:.0f}", f"-seed={seed + 1}", f"-max_len={MOST_BYTES}", "-rss_limit_mb=0"]
        words += ["-timeout=0", f"-artifact_prefix={folder}/", "-print_final_stats=1", str(sound)]
        atheris.Setup([sys.argv[0], *words], one, custom_mutator=lambda *given: wounded(kind, *given))
        atheris.Fuzz()


def main():
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzzing.guided", description=__doc__.partition("\n")[0])
    parser.add_argument("kind", choices=fuzz.READERS, metavar="KIND")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path("broken"), metavar="FOLDER")
    arguments = parser.parse_args()
    guide(arguments.kind, arguments.seconds, arguments.seed, arguments.keep)


if __name__ == "__main__":
    main()
