"""Rays shared out to threads: every ray once, whole slices, and nothing lost when something goes wrong."""

import threading

import numpy as np
import pytest

from cgi_wave.errors import InputError
from cgi_wave.kernels.trace import SLICE
from cgi_wave.rays.sharing import helpers, share_out


@pytest.mark.parametrize("count", [0, 1, SLICE, 9 * SLICE + 1, 300 * SLICE - 1])
@pytest.mark.parametrize("threads", [1, 2, 3, 7])
def test_every_ray_is_in_one_range_and_ranges_begin_at_slices(count, threads):
    seen, begins = np.zeros(count, dtype=int), []

    def part(begin, end):
        seen[begin:end] += 1
        begins.append(begin)

    share_out(part, count, threads)
    assert (seen == 1).all() and all(begin % SLICE == 0 for begin in begins)


def test_a_thread_that_is_held_up_does_not_hold_up_its_part():
    """One range waits until all others are done: somebody else has to have done them."""
    count, done, everything_else = 64 * SLICE, set(), threading.Event()
    ranges = []
    share_out(lambda begin, end: ranges.append(begin), count, 2)

    def part(begin, end):
        if begin == 0:
            assert everything_else.wait(10.0)
        done.add(begin)
        if len(done) == len(ranges) - 1:
            everything_else.set()

    share_out(part, count, 2)
    assert len(done) == len(ranges) > 4


@pytest.mark.parametrize("at", [0, 40 * SLICE])
def test_what_a_part_raises_comes_through_on_whichever_thread(at):
    running = []

    def part(begin, end):
        running.append(begin)
        try:
            if begin <= at < end:
                raise IndexError("of the part's own")
        finally:
            running.remove(begin)

    for _ in range(20):
        with pytest.raises(IndexError, match="own"):
            share_out(part, 64 * SLICE, 2)
        assert not running


def test_parts_may_share_out_themselves():
    """More calls than threads, each waiting for what it has shared out: none waits for ever."""
    total, lock = [0], threading.Lock()

    def inner(begin, end):
        with lock:
            total[0] += end - begin

    share_out(lambda begin, end: share_out(inner, end - begin, 2), 100 * SLICE, 2)
    assert total == [100 * SLICE]


def test_threads_are_kept_and_not_heaped_up():
    before = threading.active_count()
    for _ in range(20):
        share_out(lambda begin, end: None, 100 * SLICE, 3)
    assert threading.active_count() <= before + 2 and helpers(2) is helpers(2)


def test_no_threads_are_refused():
    with pytest.raises(InputError, match="threads"):
        share_out(lambda begin, end: None, 10, 0)
