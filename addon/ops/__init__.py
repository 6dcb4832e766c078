# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: thin, each one thing that a person does."""

from importlib import import_module
from pkgutil import iter_modules

OPERATOR_MODULES = [import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__)]
