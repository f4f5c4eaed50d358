"""Blocked, pruned transforms against the sum; wisdom that is kept, and that may be broken."""

import threading

import numpy as np
import pytest

from cgi_wave.wave.methods import plans
from cgi_wave.wave.methods.plans import fast_length, transform_rows, wisdom_file


@pytest.mark.parametrize(
    ("first", "given", "size", "start", "count"), [(-7, 15, 30, -8, 16), (0, 30, 30, 0, 30), (25, 20, 48, -40, 33)]
)
def test_is_the_sum(first, given, size, start, count):
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(37, given)) + 1j * rng.normal(size=(37, given))
    j, k = np.arange(given) + first, np.arange(count) + start
    want = rows @ np.exp(2j * np.pi * np.outer(j, k) / size)
    assert transform_rows(rows, first, size, start, count) == pytest.approx(want.T, abs=1e-12)


def test_refuses_what_does_not_fit():
    with pytest.raises(ValueError, match="do not fit"):
        transform_rows(np.zeros((1, 40), complex), 0, 32, 0, 8)


def test_fast_lengths_are_even_and_not_shorter():
    for size in (1, 17, 1025, 4099):
        assert fast_length(size) >= size
        assert fast_length(size) % 2 == 0


def test_threads_share_plans():
    rng = np.random.default_rng(4)
    rows = [rng.normal(size=(40, 64)) + 0j for _ in range(8)]
    want = [np.fft.ifft(r, 128, axis=1).T * 128 for r in rows]
    got: dict[int, object] = {}

    def work(i):
        for _ in range(20):
            got[i] = transform_rows(rows[i], 0, 128, 0, 128)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i in range(8):
        assert got[i] == pytest.approx(want[i], abs=1e-11)


def test_wisdom_is_written_whole_and_forgiven_when_broken(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(plans, "_plans", {})
    monkeypatch.setattr(plans, "_loaded", False)
    file = wisdom_file()
    assert file.parent == tmp_path / "cgi-wave"
    file.parent.mkdir()
    file.write_text('["(nonsense", 3]')
    rows = np.ones((1, 12), complex)
    assert transform_rows(rows, 0, 12, 0, 1)[0, 0] == pytest.approx(12.0)
    assert "fftw" in file.read_text()
    assert [f.name for f in file.parent.iterdir()] == [file.name]


def test_a_folder_that_cannot_be_written_costs_nothing(monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    monkeypatch.setattr(plans, "_plans", {})
    assert transform_rows(np.ones((1, 18), complex), 0, 18, 0, 1)[0, 0] == pytest.approx(18.0)
