# SPDX-License-Identifier: GPL-3.0-or-later
"""`verify RESULTS`: whether results are what was made of these inputs, edits, options and version."""

from pathlib import Path

from ..core.data.errors import JobError
from ..io.provenance import MADE_OF, REPORT, differences, is_labelled, open_provenance, reports_meant
from ..version import version
from .console import complain, of_take, print_results

DESCRIPTION = """Says in one line for each take whether its results are what label or fill made of these inputs, model,
cameras, edits, options and version: by the SHA-256 of each file that its report tells. Nothing is done again. Inputs
are looked for where they were, as seen from the results, and beside these."""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("verify", help="say whether results are as they were made", description=DESCRIPTION)
    what = "a folder of results, or of one take its report, another result or the stem of them all"
    parser.add_argument("results", metavar="RESULTS", type=Path, help=what)
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Verifies every take that is meant; one that is not as it was does not stop the others."""
    takes, lines, failed = [], [], []
    for path in reports_meant(arguments.results):
        stem = path.name.removesuffix(REPORT)
        try:
            report = open_provenance(path)
            changed = differences(path, report, version(), arguments.results)
            takes.append({"take": stem, "report": str(path), "verified": not changed, "differences": changed})
            if changed:
                done = "labelled" if is_labelled(report["provenance"]) else "filled"
                raise JobError(f"{', '.join(changed)}; expected all as it was when this take was {done}", path)
            lines.append(f"{stem}: {_made(report['provenance'])}")
        except Exception as error:  # noqa: BLE001 - every take is its own
            failed.append((stem, of_take(error, path, arguments.traceback)))
    troubles = [{"take": stem, "status": one.exit_status, "reason": str(one)} for stem, one in failed]
    if lines or arguments.json:
        print_results(lines, {"takes": takes, "failed": troubles}, arguments.json)
    for _, trouble in failed:
        complain(trouble)
    return max((trouble.exit_status for _, trouble in failed), default=0)


def _made(made: dict) -> str:
    """What is verified of a take."""
    names = [row["file"].rpartition("/")[2] for kind in MADE_OF for row in made[kind]]
    return f"{len(made['results'])} results are as version {made['version']} made them of {', '.join(names)}"
