"""One-dimensional Fourier transforms in blocks, by measured FFTW plans that are made once and kept between runs."""

from __future__ import annotations

import json
import os
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCK = 16  # rows that one plan transforms: one plan per length serves arrays of any number of rows
_FILE = "fftw-wisdom.json"
_planning = threading.Lock()  # FFTW's planner is not safe in several threads
_plans: dict[int, _Plan] = {}
_loaded = False


class _Plan:
    """An out-of-place plan of one length and the arrays that it owns; hold ``lock`` while using them."""

    def __init__(self, size: int) -> None:
        import pyfftw

        self.lock = threading.Lock()
        self.source: NDArray[np.complex128] = pyfftw.zeros_aligned((BLOCK, size), dtype="complex128")
        self.result: NDArray[np.complex128] = pyfftw.zeros_aligned((BLOCK, size), dtype="complex128")
        flags = ("FFTW_MEASURE",)
        self.transform: Any = pyfftw.FFTW(
            self.source, self.result, axes=(1,), direction="FFTW_BACKWARD", flags=flags, threads=1
        )
        self.source[:] = 0.0  # measuring has used it


def cache_folder() -> Path:
    """Where what was measured on this machine is kept: the user's cache folder, XDG_CACHE_HOME where that is set."""
    from platformdirs import user_cache_path

    base = os.environ.get("XDG_CACHE_HOME")
    return Path(base) / "cgi-wave" if base else user_cache_path("cgi-wave", appauthor=False)


def wisdom_file() -> Path:
    """Where FFTW's plans are kept."""
    return cache_folder() / _FILE


def _load() -> None:
    """Take what an earlier run measured. A file that cannot be read or understood is as good as none."""
    import pyfftw

    try:
        kept = json.loads(wisdom_file().read_text(encoding="ascii"))
        pyfftw.import_wisdom(tuple(part.encode("ascii") for part in kept))
    except (OSError, ValueError, TypeError, AttributeError):
        pass


def _save() -> None:
    """Write all wisdom, whole or not at all; a folder that cannot be written costs only the next run's planning."""
    import pyfftw

    file = wisdom_file()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=_FILE)
        try:
            with os.fdopen(handle, "w", encoding="ascii") as out:
                json.dump([part.decode("ascii") for part in pyfftw.export_wisdom()], out)
            os.replace(name, file)
        except OSError:
            os.unlink(name)
            raise
    except OSError:
        pass


def _plan(size: int) -> _Plan:
    global _loaded
    with _planning:
        if size not in _plans:
            if not _loaded:
                _load()
                _loaded = True
            _plans[size] = _Plan(size)
            _save()
        return _plans[size]


def fast_length(size: int) -> int:
    """The least even length from ``size`` on that transforms fast (small prime factors)."""
    import pyfftw

    length = int(pyfftw.next_fast_len(max(int(size), 2)))
    while length % 2:
        length = int(pyfftw.next_fast_len(length + 1))
    return length


def transform_rows(
    rows: NDArray[np.complex128], first: int, size: int, start: int, count: int
) -> NDArray[np.complex128]:
    """(count, R) sums Σ_j rows[r, j] exp(+i 2π (first + j) k / size), for k = start … start + count − 1.

    rows (R, M), M <= size and count <= size: entries not given are 0, results not asked for are dropped. The result
    is transposed, so that two calls transform both axes.
    """
    total, given = rows.shape
    if given > size or count > size:
        raise ValueError(f"{given} samples and {count} results do not fit a transform of {size}")
    plan = _plan(size)
    into = _spans(first, given, size)
    take = _spans(start, count, size)
    out = np.empty((count, total), np.complex128)
    with plan.lock:
        plan.source[:] = 0.0
        for r in range(0, total, BLOCK):
            height = min(BLOCK, total - r)
            for at, where, length in into:
                plan.source[:height, where : where + length] = rows[r : r + height, at : at + length]
            plan.transform.execute()
            for at, where, length in take:
                out[at : at + length, r : r + height] = plan.result[:height, where : where + length].T
    return out


def _spans(first: int, count: int, size: int) -> list[tuple[int, int, int]]:
    """Pieces (at, where, length) by which indices first … first + count − 1 lie on a circle of ``size``."""
    where = first % size
    length = min(count, size - where)
    pieces = [(0, where, length)]
    if length < count:
        pieces.append((length, 0, count - length))
    return pieces
