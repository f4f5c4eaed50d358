"""The coherency matrix of several beams is positive; contrasts in a band against closed forms."""

import numpy as np
import pytest
from synthetic_beams import SIGMA, beam

from cgi_wave.errors import MethodLimitError
from cgi_wave.wave.basis import chebyshev_wavenumbers
from cgi_wave.wave.field import fit_field
from cgi_wave.wave.gram import gram, polychromatic
from cgi_wave.wave.hopkins import HopkinsPair


def test_defocused_beams_overlap_by_their_difference():
    waves = (0.0, 0.4, 3.2, 40.7)
    fields = [HopkinsPair(w020=w).pupil_fields()[0] for w in waves]
    found = gram(fields, 1.0, 1e-9)
    difference = np.subtract.outer(waves, waves)
    exact = np.exp(1j * np.pi * difference) * np.sinc(difference)
    assert np.all(np.abs(found.value - exact) <= found.error + 1e-14)
    assert found.error.max() < 1e-8
    assert found.left_out == ()
    assert np.allclose(found.value, found.value.conj().T)
    assert np.linalg.eigvalsh(found.value)[0] > -1e-14


def test_beams_that_cancel_leave_no_light_and_never_less():
    # the same beam twice, half a wave apart
    one, other = fit_field(beam()), fit_field(beam(phase=np.pi))
    found = gram([one, other, fit_field(beam(lambda x, y: 1e-4 * x))], SIGMA, 1e-4)
    assert found.irradiance(np.array([1.0, 1.0, 0.0])) == pytest.approx(0.0, abs=1e-9)
    rng = np.random.default_rng(1)
    assert all(found.irradiance(rng.uniform(0, 1, 3)) >= -1e-14 for _ in range(50))


def test_a_band_turns_defocus_into_an_envelope():
    # W = w σ/σ0 s over s in (0, 1), flat weight over σ0(1 ± d): value against a two-dimensional mean
    w, half = 6.3, 0.05
    sigma = chebyshev_wavenumbers(SIGMA * (1 - 1.2 * half), SIGMA * (1 + 1.2 * half), 4)
    moved = fit_field(beam(path=lambda x, y, s: w / SIGMA * (x**2 + y**2), sigma=sigma))
    flat = fit_field(beam(sigma=sigma))
    fine = SIGMA * np.linspace(1 - half, 1 + half, 2001)
    value, error = polychromatic((moved, flat), fine, np.ones(fine.size))
    exact = np.mean(np.exp(1j * np.pi * w * fine / SIGMA) * np.sinc(w * fine / SIGMA))
    assert abs(value - exact) <= error
    assert error < 1e-4


def test_a_spectrum_too_coarse_for_the_path_difference_is_refused():
    sigma = chebyshev_wavenumbers(0.95 * SIGMA, 1.05 * SIGMA, 3)
    far = fit_field(beam(path=lambda x, y, s: np.full_like(x, 1e-3), sigma=sigma))
    near = fit_field(beam(sigma=sigma))
    with pytest.raises(MethodLimitError, match="sampled every") as info:
        polychromatic((far, near), SIGMA * np.linspace(0.96, 1.04, 50), np.ones(50))
    assert info.value.factor == pytest.approx(4e-3 * 0.08 * SIGMA / 49, rel=1e-6)
