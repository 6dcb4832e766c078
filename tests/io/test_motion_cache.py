# SPDX-License-Identifier: GPL-3.0-or-later
"""Point caches: what is not known is on straight lines, whatever the parts, and another file is told."""

import re

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.io import poses
from addon.io.poses import PC2_HEADER, cache_mark, check_cache, write_cache

FRAMES, VERTICES = 40, 3


@pytest.fixture
def known():
    """(F, V, 3) frames with gaps at both ends, in the middle and between, and a vertex that is never known."""
    frames = np.random.default_rng(5).normal(size=(FRAMES, VERTICES, 3))
    frames[:7, 0] = frames[33:, 0] = frames[10:30, 0] = np.nan
    frames[::2, 1, 0] = np.nan
    frames[:, 2] = np.nan
    return frames


def expected(known, absent):
    """The same with straight lines, column by column."""
    flat, rest = known.reshape(FRAMES, -1).astype(np.float32).astype(float), absent.ravel()
    for column in range(flat.shape[1]):
        there = np.isfinite(flat[:, column])
        at = np.arange(FRAMES)
        flat[:, column] = np.interp(at, at[there], flat[there, column]) if there.any() else rest[column]
    return flat.reshape(known.shape)


@pytest.mark.parametrize("part", [1, 3, 7, 64])
def test_gaps_are_straight_lines_whatever_the_parts(tmp_path, monkeypatch, known, part):
    monkeypatch.setattr(poses, "PART_BYTES", part * 12 * VERTICES)
    path, absent = tmp_path / "walk.pc2", np.arange(9.0).reshape(3, 3)
    write_cache(path, (known[start : start + 11] for start in range(0, FRAMES, 11)), absent)
    data = path.read_bytes()
    assert PC2_HEADER.unpack(data[: PC2_HEADER.size]) == (b"POINTCACHE2\0", 1, VERTICES, 0.0, 1.0, FRAMES)
    found = np.frombuffer(data[PC2_HEADER.size :], "<f4").reshape(known.shape)
    np.testing.assert_allclose(found, expected(known, absent), rtol=1e-6)
    there = np.isfinite(known)
    np.testing.assert_array_equal(found[there], known[there].astype(np.float32))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda path: path.unlink(), "is not there"),
        (lambda path: path.write_bytes(path.read_bytes()[:-4]), "is shorter than it was saved"),
        (lambda path: path.write_bytes(b"Something else altogether" * 99), "is no point cache"),
        (lambda path: path.write_bytes(path.read_bytes()[:-4] + b"1234"), "is of another take"),
        (lambda path: path.write_bytes(path.read_bytes() + b"1234"), "is of another take"),
    ],
)
def test_another_file_is_told(tmp_path, known, spoil, words):
    path = tmp_path / "walk.pc2"
    write_cache(path, iter([known]), np.zeros((3, 3)))
    mark = cache_mark(path)
    check_cache(path, mark)
    spoil(path)
    with pytest.raises(InputError, match=re.escape(words)):
        check_cache(path, mark)
