# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `python -m tests.fuzz`."""

import sys

from . import main

sys.exit(main())
