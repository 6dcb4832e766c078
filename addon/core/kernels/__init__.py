# SPDX-License-Identifier: GPL-3.0-or-later
"""Hot functions in C, each beside the NumPy function of the same name, which is the reference and stands in for it.

`library` finds and loads the compiled library, `calls` hands it arrays whose sizes it has checked.
"""

from .library import compiled, in_use, stands_for

__all__ = ["compiled", "in_use", "stands_for"]
