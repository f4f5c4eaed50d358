"""Rays shared out to threads: each has a part of its own, and helps with the others' when that is done.

Threads are started when first needed and kept: to start one takes as long as tracing some 20 000 ray surfaces, and a
fan of 1e5 rays through a lens is traced in 3 ms. Idle ones cost nothing.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from functools import lru_cache
from itertools import pairwise

from cgi_wave.errors import InputError
from cgi_wave.kernels.trace import SLICE

#: Ranges that a thread's part is cut into, at most, and slices that a range has at least: what is still to be fetched
#: at the end keeps the threads apart by no more than a range, and a call costs some ten microseconds.
RANGES, LEAST = 16, 4


@lru_cache(maxsize=4)
def helpers(count: int) -> ThreadPoolExecutor:
    """``count`` threads that are kept for the next call; those of numbers long unused end by themselves."""
    return ThreadPoolExecutor(count, thread_name_prefix="rays")


if hasattr(os, "register_at_fork"):  # a child process has none of its parent's threads
    os.register_at_fork(after_in_child=helpers.cache_clear)


def check_threads(threads: int) -> None:
    """Raises InputError where ``threads`` is no number of threads."""
    if threads < 1:
        raise InputError("trace", "threads", threads, "is no number of threads", "give 1 or more")


def share_out(part: Callable[[int, int], None], count: int, threads: int) -> None:
    """Call ``part(begin, end)`` for ranges that make up 0 … count, on the caller's thread and ``threads`` − 1 others.

    Ranges begin at whole slices, so that every ray has the same place in its slice whoever traces it. What ``part``
    raises is raised here, when no thread is at work any more. It may share out itself.
    """
    check_threads(threads)
    slices = -(-count // SLICE)
    ranges = min(threads * RANGES, -(-slices // LEAST))
    edges = [min(SLICE * (k * slices // ranges), count) for k in range(ranges)] + [count]
    every = list(pairwise(edges))
    threads = min(threads, ranges)
    if threads <= 1:
        for begin, end in every:
            part(begin, end)
        return
    # A stretch of its own for each: memory that is written for the first time is cleared in pieces of up to 2 MB, and
    # two threads that come to the same piece at once both clear it.
    own = [deque(every[k * ranges // threads : (k + 1) * ranges // threads]) for k in range(threads)]

    def left(mine: deque[tuple[int, int]]) -> Iterator[tuple[int, int]]:
        while any(own):
            # Of another's part the far end: its owner comes there last.
            theirs = max(own, key=len)
            try:
                yield mine.popleft() if mine else theirs.pop()
            except IndexError:  # another thread took it in between
                continue

    def work(mine: deque[tuple[int, int]]) -> None:
        for begin, end in left(mine):
            part(begin, end)

    others = [helpers(threads - 1).submit(work, mine) for mine in own[1:]]
    try:
        work(own[0])
    finally:
        # After an exception nothing is left to fetch. What has not begun need not: where the helpers are all busy,
        # perhaps with calls that wait for this one, the caller has done everything itself.
        for mine in own:
            mine.clear()
        begun = [other for other in others if not other.cancel()]
        wait(begun)
    for other in begun:
        other.result()
