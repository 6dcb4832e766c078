# SPDX-License-Identifier: GPL-3.0-or-later
"""`label INPUT…`: names the markers of one or more takes."""

from .options import add_label_options
from .running import run


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    add_label_options(verbs).set_defaults(run=run)
