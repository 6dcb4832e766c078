# SPDX-License-Identifier: GPL-3.0-or-later
"""Mocap Autolabel as a Blender extension.

Importing this costs nothing and needs no Blender: the add-on is loaded when Blender enables it.
"""


def register() -> None:
    """Add everything of the add-on to Blender, or nothing when that fails."""
    from .addon import registration

    registration.register()


def unregister() -> None:
    """Take everything that `register` added out of Blender again."""
    from .addon import registration

    registration.unregister()
