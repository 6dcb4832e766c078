# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables on disk are read and written as arrays are, and are gone with their folder."""

from contextlib import ExitStack

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from addon.core.data.errors import JobError
from addon.io.tables import FileTable, Room

SHAPE = 7, 3, 2
WANTED = st.one_of(
    st.slices(SHAPE[0]).filter(lambda part: part.step is None or part.step > 0),
    arrays(int, st.integers(0, 5), elements=st.integers(0, SHAPE[0] - 1), unique=True),
    arrays(bool, SHAPE[0]),
    st.just((np.array([4, 2, 5]), np.array([0, 2, 1]))),  # by frame and lane
)


@settings(max_examples=60)
@given(st.lists(st.tuples(WANTED, st.integers(-9, 9)), max_size=4), WANTED)
def test_a_table_on_disk_is_as_an_array(tmp_path_factory, written, wanted):
    array, table = np.zeros(SHAPE), FileTable(tmp_path_factory.mktemp("room") / "table", SHAPE, float)
    for index, value in written:
        array[index] = table[index] = value
    np.testing.assert_array_equal(table[wanted], array[wanted])
    np.testing.assert_array_equal(np.asarray(table), array)
    assert (len(table), table.size, table.ndim) == (7, 42, 3)


def test_only_large_tables_are_on_disk_and_go_with_the_job_and_a_folder_without_room_is_said(tmp_path):
    with ExitStack() as stack:
        room = Room(stack, min_bytes=1000)
        assert isinstance(room((10, 12), np.float64), np.ndarray)
        assert room.folder is None
        large = room((10, 13), np.float64)
        assert large.path.exists()
        assert not large[2:5].any()
    assert not large.path.parent.exists()
    with pytest.raises(JobError, match="cannot hold temporary files"):
        FileTable(tmp_path / "gone" / "table", SHAPE, float)
