# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages that people pass on: one file each, that asks for nothing from elsewhere and runs nothing.

Text, tables and inline SVG only, so no library is needed: `markup` builds elements and escapes whatever is put into
them, `style` says how they look, `drawings` makes the pictures of a take, `take_page` and `folder_page` are the pages.
They are HTML that is well-formed XML too, so that tests can look into them.
"""

from .markup import is_page
from .pages import write_folder_page, write_take_page

__all__ = ["is_page", "write_folder_page", "write_take_page"]
