# SPDX-License-Identifier: GPL-3.0-or-later
"""`fill TAKE`: the gaps of a labelled take."""

from pathlib import Path

from ..core.data.wording import count_of, words_of_frames
from ..core.filling.filling import FILL_METHODS
from ..io.models import open_model
from ..jobs.fill import FillJob, fill_file
from .arguments import add_options, job_of, names, whole
from .console import not_in_c3d, report_work

DESCRIPTION = """Fills the gaps of a labelled take, a .c3d, .trc or .tsv. Measured samples stay as they are; filled ones
have the residual 0 in FILE.c3d. FILE.filled.csv says of each gap the method and the mean error to expect,
FILE.report.json where every sample is from, for verify."""
LEFT_SHOWN = 5  # gaps that were left, shown to people one by one


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("fill", help="fill the gaps of a labelled take", description=DESCRIPTION)
    parser.add_argument("source", metavar="TAKE", type=Path, help="a labelled take: .c3d, .trc or .tsv")
    parser.add_argument("--out", required=True, type=Path, metavar="FILE.c3d", help="the .c3d to write")
    parser.add_argument(
        "--method",
        choices=FILL_METHODS,
        default="auto",
        help="spline; rigid: the body that the nearest markers make; pattern: the path of one neighbour; pca: the "
        "principal components of the take; body: the body of --model, fitted; regression: learned from the take's own "
        "frames; auto (default): regression, or else the first of pca, body and spline that is sure enough",
    )
    parser.add_argument(
        "--max-gap", type=whole(1, 10**9, "number of frames"), metavar="FRAMES", help="leave longer gaps"
    )
    parser.add_argument("--markers", type=names, default=(), metavar="A,B,…", help="fill only these markers")
    add_options(parser, "--model", help="a model of these markers, whose body may fill gaps too")
    add_options(parser, "--up", "--rate", "--plain", "--overwrite")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Fills one take."""
    job = job_of(FillJob, arguments)
    if job.model is not None:
        open_model(job.model)  # a name that is none is no path of a file
    return report_work(arguments, fill_file(job), job.source.stem, _lines)


def _lines(result: dict) -> list[str]:
    """What is said to people."""
    expected = [row["expected_mm"] for row in result["filled"] if row["expected_mm"] is not None]
    often = f"{len(result['filled']):,} of {count_of(len(result['filled']) + len(result['left']), 'gap')} filled"
    samples = f"{result['samples_filled']:,} of {count_of(result['samples_missing'], 'missing sample')}"
    off = f", expected error up to {max(expected):.1f} mm" if expected else ""
    lines = [
        f"{result['out']}: {count_of(result['frames'], 'frame')}, {often}, {samples}{off}, {result['seconds']:.1f} s"
    ]
    left = result["left"][:LEFT_SHOWN]
    lines += [
        f"left: {row['marker']}, {words_of_frames(row['first'], row['last'])}: the gap {row['reason']}" for row in left
    ]
    if len(result["left"]) > LEFT_SHOWN:
        lines.append(f"left: {len(result['left']) - LEFT_SHOWN} more, see --json")
    if result["never_seen"]:
        lines.append(f"never seen, so not filled: {', '.join(result['never_seen'])}")
    return [*lines, *not_in_c3d(result), *result["notes"]]
