# SPDX-License-Identifier: GPL-3.0-or-later
"""The searches for solvers: traced by hand, against all subsets, and the genetic operators one by one."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.papers.partial_solvers import search
from tests.core.papers.partial_solvers.plain import exhaustive, without_supersets

SIX = st.sets(st.integers(1, 63), min_size=1, max_size=5)


def last(steps):
    *_, (_, found) = steps
    return found


def growing(least):
    """Good is what contains one of `least`: the paper's second property holds."""
    return lambda subset: any(subset & small == small for small in least)


def test_bottom_up_by_hand():
    asked = []

    def good(subset):
        asked.append(subset)
        return subset in (0b011, 0b111)

    # Size 1: none. Size 2: 011 is good and stays; 101 and 110 grow to 111, which contains it.
    assert last(search.bottom_up(3, good)) == {0b011}
    assert sorted(asked) == [1, 2, 3, 4, 5, 6]


def test_top_down_by_hand():
    # 1111 is good, so are 0111 and 0011; 0001 and 0010 are not.
    good = {0b1111, 0b0111, 0b0011}.__contains__
    sizes = [(size, set(found)) for size, found in search.top_down(4, good)]
    assert sizes == [(4, set()), (3, set()), (2, {0b0011}), (1, {0b0011})]


def test_top_down_keeps_a_parent_without_good_children():
    assert last(search.top_down(3, {0b111}.__contains__)) == {0b111}
    assert last(search.top_down(3, set().__contains__)) == set()


@given(SIX)
def test_greedy_searches_find_what_all_subsets_show(least):
    good = growing(least)
    expected = exhaustive(6, good)
    assert expected == without_supersets(set(least))
    assert last(search.bottom_up(6, good)) == expected
    assert last(search.top_down(6, good)) == expected


@given(SIX, st.integers(0, 5))
def test_one_run_for_one_marker(least, own):
    least = {subset | 1 << own for subset in least}
    good = growing(least)
    expected = exhaustive(6, good, own)
    assert all(subset >> own & 1 for subset in expected)
    assert last(search.bottom_up(6, good, own)) == expected
    assert last(search.top_down(6, good, own)) == expected


genes = st.lists(st.booleans(), min_size=2, max_size=12).map(np.array).filter(lambda row: row.any())


@given(genes, st.integers(0, 99))
def test_mutations(parent, seed):
    generator = np.random.default_rng(seed)
    before = parent.copy()
    swapped, more, less = (
        mutate(parent, generator) for mutate in (search.permutation, search.addition, search.subtraction)
    )
    assert (parent == before).all()
    assert swapped.sum() == parent.sum()
    assert (swapped != parent).sum() == (0 if parent.all() else 2)
    assert more.sum() == min(parent.sum() + 1, len(parent))
    assert (more >= parent).all()
    assert less.sum() == max(parent.sum() - 1, 1)
    assert (less <= parent).all()


def test_crossover_takes_every_gene_from_a_parent():
    one, other = np.array([True] * 200 + [False] * 200), np.array([True] * 100 + [False] * 300)
    child = search.crossover(one, other, np.random.default_rng(0))
    assert child[:100].all()
    assert not child[200:].any()
    assert 25 < child[100:200].sum() < 75


def fitness_of(least):
    return lambda subset: max((subset & small).bit_count() / small.bit_count() for small in least)


def run(options, least=(0b00010011, 0b11000001), seed=0, own=None):
    return list(search.genetic(8, fitness_of(least), options, np.random.default_rng(seed), own))


def test_the_genetic_search_improves_and_prefers_the_small():
    steps = run(search.Genetics(population=24, generations=30))
    means = [mean for mean, _ in steps]
    assert means[-1] > means[0]
    assert all(after >= before - 0.05 for before, after in pairwise(means[5:]))
    best = steps[-1][1]
    assert fitness_of((0b00010011, 0b11000001))(best[0]) == 1.0
    assert best[0] in (0b00010011, 0b11000001)
    sizes = [subset.bit_count() for subset in best]
    assert sizes == sorted(sizes)


@pytest.mark.parametrize(("die_out", "born"), [(0.25, 20), (0.5, 60)])
def test_a_quarter_dies(die_out, born):
    asked = []

    def fitness(subset):
        asked.append(subset)
        return 1.0 / subset.bit_count()

    options = search.Genetics(60, 5, die_out=die_out)
    alive: list[int] = []
    told = 0
    for _, survivors in search.genetic(16, fitness, options, np.random.default_rng(0)):
        new = asked[told:]
        assert len(new) <= (60 if not alive else 0) + born
        candidates = {*alive, *new}
        assert len(survivors) == min(60, round(len(candidates) * (1 - die_out)))
        assert set(survivors) <= candidates
        dead = candidates - set(survivors)
        assert min(subset.bit_count() for subset in dead) >= max(subset.bit_count() for subset in survivors)
        alive, told = survivors, len(asked)


def test_the_genetic_search_repeats_itself_for_a_seed():
    options = search.Genetics(population=16, generations=8)
    assert run(options) == run(options)
    assert run(options) != run(options, seed=1)


def test_covering_takes_few_that_answer_most():
    hidden = np.array([0b0001, 0b0010, 0b0100, 0b1000])
    taken = list(search.covering([0b0011, 0b0110, 0b1111, 0b1001], lambda _: True, lambda _: (), hidden, 9, 0.0))[-1]
    # 0011 answers when 4 or 8 is hidden; then 0110 adds 1, and 1001 adds 2. All four markers are never there.
    assert taken == {0b0011, 0b0110, 0b1001}


def test_covering_asks_heirs_of_what_does_not_hold():
    hidden = np.zeros(5, dtype=int)
    taken = list(search.covering([0b01], {0b11}.__contains__, lambda subset: [subset | 0b10], hidden, 3, 0.0))[-1]
    assert taken == {0b11}
