# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, the same behind both doors: Blender's `--command mocap_autolabel` and the script `mocap-autolabel`.

Every verb has a file here with `add_parser`; this one turns whatever happens into an exit status and one last line.
"""

import sys

DONE, FAILED, BAD_INPUT = 0, 1, 2


def main(argv: list[str] | None = None) -> int:
    """Runs one command and gives its exit status; argv without the program's name, default: the process's own."""
    try:
        return _main(sys.argv[1:] if argv is None else list(argv))
    except KeyboardInterrupt:
        from ..io.scratch import take_away_own
        from .console import complain

        take_away_own()
        complain("stopped before the end; nothing half-written was left")
        return FAILED


def _main(argv: list[str]) -> int:
    # Here and not above: whoever presses Ctrl-C while these are loaded has the sentence too.
    from .console import as_trouble, complain, open_streams, stoppable, telling
    from .serving import try_libraries

    open_streams()
    try:
        with stoppable():
            try_libraries()
            # Where memory lacks for these, there is a sentence too.
            from ..blendfile import drop_banner
            from ..io.whole import LeftAlone

            drop_banner()
            with telling(LeftAlone):
                return _run(argv)
    except SystemExit as error:  # --help and --version
        return DONE if error.code in (None, 0) else BAD_INPUT
    except Exception as error:  # noqa: BLE001 - the contract promises one sentence, never a traceback, for our own faults too
        trouble = as_trouble(error, "--traceback" in argv)
        complain(trouble)
        return trouble.exit_status


def _run(argv: list[str]) -> int:
    from pathlib import Path

    from .parser import build_parser
    from .serving import HANDED, SERVE, run_work, serve, uncollected

    if argv == [SERVE]:
        return serve(main)
    if len(argv) == 3 and argv[0] == HANDED:
        return run_work(*map(Path, argv[1:]))
    with uncollected():
        arguments = build_parser(argv).parse_args(argv)
    return arguments.run(arguments)
