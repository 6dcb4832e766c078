# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is named in trouble."""

import pytest

from addon.core.data.errors import ForceableError, InputError, of_file


@pytest.mark.parametrize(
    ("trouble", "file"),
    [(InputError("bad"), "own.json"), (InputError("bad", "b.csv"), "b.csv"), (ForceableError("bad"), "")],
)
def test_trouble_of_the_kind_gets_the_file_it_lacks(trouble, file):
    with pytest.raises(type(trouble), match="bad") as caught, of_file("own.json", InputError):
        raise trouble
    assert caught.value.file == file
