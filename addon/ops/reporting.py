# SPDX-License-Identifier: GPL-3.0-or-later
"""Trouble that the user can mend becomes one report; whatever else goes wrong is ours and propagates."""

from collections.abc import Callable
from functools import wraps

from ..core.data.errors import UserError


def reports_trouble(method: Callable[..., set[str]]) -> Callable[..., set[str]]:
    """Wraps an operator's method of a context, such as `execute`: a `UserError` ends it with one readable sentence."""

    @wraps(method)
    def run(self, context) -> set[str]:
        try:
            return method(self, context)
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    return run
