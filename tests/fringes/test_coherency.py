"""Pairs by columns: what goes in comes out again."""

import numpy as np

from cgi_wave.fringes.coherency import LeftOut, LeftOutPairs

ROWS = [LeftOut(0, 2, 1e-4, "small", 0.5), LeftOut(1, 2, 2e-4, "switched off", 1.0), LeftOut(1, 3, 3e-4, "small", 0.0)]


def test_columns_hold_the_rows():
    columns = LeftOutPairs.of(ROWS)
    assert list(columns) == ROWS and len(columns) == 3
    assert list(columns.some(columns.bound > 1.5e-4)) == ROWS[1:]
    assert list(columns.extended([LeftOut(5, 6, 1e-6, "no field", 2.0)])) == [
        *ROWS,
        LeftOut(5, 6, 1e-6, "no field", 2.0),
    ]


def test_none_left_out():
    none = LeftOutPairs.of(())
    assert len(none) == 0 and list(none) == [] and list(none.extended(ROWS)) == ROWS
    assert none.m.dtype == np.int64
