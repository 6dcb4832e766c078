# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, the same behind both doors: Blender's `--command mocap_autolabel` and the script `mocap-autolabel`.

Every verb has a file here with `add_parser`; this one turns whatever happens into an exit status and one last line.
"""

import os
import sys
import traceback

from ..blendfile import drop_banner
from ..core.data.errors import UserError
from .console import complain, open_streams, stoppable
from .parser import build_parser

DONE, FAILED, BAD_INPUT = 0, 1, 2


def main(argv: list[str] | None = None) -> int:
    """Runs one command and gives its exit status; argv without the program's name, default: the process's own."""
    argv = sys.argv[1:] if argv is None else list(argv)
    open_streams()
    drop_banner()
    try:
        with stoppable():
            arguments = build_parser().parse_args(argv)
            return arguments.run(arguments)
    except UserError as error:
        complain(error)
        return error.exit_status
    except SystemExit as error:  # --help and --version
        return DONE if error.code in (None, 0) else BAD_INPUT
    except KeyboardInterrupt:
        complain("stopped before the end; nothing half-written was left")
    except BrokenPipeError:
        complain("the program that reads the results went away; expected it to read them all")
    except MemoryError:
        complain("the memory is full; expected fewer frames at once, see --frames, or fewer --jobs")
    except OSError as error:
        place = f"{os.fsdecode(error.filename)}: " if error.filename else ""
        complain(f"{place}the system says: {error.strerror or _line(error)}; expected a path that can be used")
        return BAD_INPUT if error.filename else FAILED
    except Exception as error:  # noqa: BLE001 - the contract promises one sentence, never a traceback, for our own faults too
        if "--traceback" in argv:
            traceback.print_exc()
        complain(f"a fault of Mocap Autolabel itself ({type(error).__name__}: {_line(error)}); please report it")
    return FAILED


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]


__all__ = ["main"]
