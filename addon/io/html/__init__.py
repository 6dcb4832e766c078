# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages that people pass on: one file each, that asks for nothing from elsewhere and runs nothing.

Text, tables and inline SVG only, so no library is needed: `markup` builds elements and escapes whatever is put into
them, and says how they look, `drawings` makes the pictures of a take, `pages` are the pages.
They are HTML that is well-formed XML too, so that tests can look into them.
"""
