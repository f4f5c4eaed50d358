"""What a detector point sees: against the sum of plane waves, Parseval, closed forms of boxes and triangles."""

import numpy as np
import pytest
from synthetic_beams import beam, disc

from cgi_wave.errors import InputError
from cgi_wave.rays.disc import disc as sunflower
from cgi_wave.rays.disc import rim
from cgi_wave.wave.field import fit_field
from cgi_wave.wave.overlap import overlap
from cgi_wave.wave.seen import cell_kernel, gathered, rays_of_pair, source_amplitude, source_pitch

SIGMA = 1.0 / 0.764e-6
RADIUS = 16.25e-3  # m, of the entrance pupil
THETA = np.array([0.031, -0.017])
PIXEL = 15e-6 / 0.13  # of direction, rad
TO_PIXELS = np.array([[-1.0, 2e-3], [1e-3, 1.01]]) / PIXEL


def pupil(defocus=0.3, coma=0.2, lead=0.0):
    """A pupil that sends the light of THETA to the detector point, with some aberration (waves)."""

    def path(x, y, sigma):
        r2 = (x**2 + y**2) / RADIUS**2
        waves = defocus * r2 + coma * r2 * y / RADIUS
        return waves / SIGMA - x * THETA[0] - y * THETA[1] + lead

    return fit_field(beam(path=path, clearances=[disc(RADIUS)], reach=1.2 * RADIUS, sigma=np.array([SIGMA]),
                          space="pupil"))  # fmt: skip


def amplitudes(*fields, reach=12.0):
    pitch = max(source_pitch(field) for field in fields)
    return [source_amplitude(field, THETA, reach * PIXEL, pitch, SIGMA) for field in fields]


def test_amplitude_is_the_sum_of_plane_waves_over_the_pupil():
    """Against a midpoint sum over 700² pupil points, phases and all, at a few directions."""
    (made,) = amplitudes(pupil())
    edge = np.linspace(-RADIUS, RADIUS, 1401)
    middle, cell = 0.5 * (edge[1:] + edge[:-1]), (edge[1] - edge[0]) ** 2
    x, y = np.meshgrid(middle, middle, indexing="ij")
    inside = x**2 + y**2 < RADIUS**2
    r2 = (x**2 + y**2) / RADIUS**2
    wave = np.where(inside, np.exp(2j * np.pi * (0.3 * r2 + 0.2 * r2 * y / RADIUS)), 0.0)
    n = len(made.x) // 2
    peak = np.abs(made.field).max()
    for i, j in ((n, n), (n + 3, n - 2), (n - 7, n + 5)):
        turned = np.exp(2j * np.pi * SIGMA * (x * made.x[i] + y * made.y[j]))
        expected = SIGMA * (wave * turned).sum() * cell
        assert abs(np.abs(made.field[i, j]) - np.abs(expected)) < 2e-3 * peak


def test_kernel_of_one_beam_is_all_its_light_and_of_two_their_mutual_intensity():
    """Parseval: ∫|H|² d²θ = ∫A² d²p, ∫ H_m H_l* d²θ = ∫ A_m A_l* d²p, but for what the window leaves out."""
    m, l = pupil(), pupil(0.9, -0.1, lead=0.2e-6)  # noqa: E741
    one, two = amplitudes(m, l)
    own = cell_kernel(one.irradiance, one.x, one.y, TO_PIXELS, 10)
    power = m.power_at(np.array([SIGMA]))[0]
    # edges scatter 2/(πv) of the light beyond v = 2πσa·r, with a ripple; a square holds about as much as its circle
    law = 2.0 / (np.pi * 2.0 * np.pi * SIGMA * RADIUS * 10.5 * PIXEL)
    assert 0.7 * law < 1.0 - own.sum() / power < 1.1 * law
    both = cell_kernel(one.field * two.field.conj(), one.x, one.y, TO_PIXELS, 10)
    truth = overlap(m, l, np.array([SIGMA]))
    exact = truth.value[0] * np.exp(2j * np.pi * SIGMA * truth.opd_m[0])
    assert both.sum() / power == pytest.approx(exact, abs=5e-3)
    turned = cell_kernel(two.field * one.field.conj(), one.x, one.y, TO_PIXELS, 10)
    np.testing.assert_allclose(turned, both.conj(), atol=1e-12 * power)
    itself = cell_kernel(one.field * one.field.conj(), one.x, one.y, TO_PIXELS, 10)
    np.testing.assert_allclose(itself, own, atol=1e-12 * power)


def test_kernel_converges_and_the_correction_for_kinks_gains():
    """With points three times closer it hardly changes; without the correction it changes more."""
    field = pupil(0.1, 0.05)
    errors = []
    (fine,) = [source_amplitude(field, THETA, 4.0 * PIXEL, source_pitch(field, 4.0), SIGMA)]
    truth = cell_kernel(fine.irradiance, fine.x, fine.y, TO_PIXELS, 2)
    (made,) = amplitudes(field, reach=4.0)
    errors.append(np.abs(cell_kernel(made.irradiance, made.x, made.y, TO_PIXELS, 2) - truth).sum() / truth.sum())
    where = np.stack(np.meshgrid(made.x, made.y, indexing="ij"), axis=-1).reshape(-1, 2) @ TO_PIXELS.T
    plain = gathered(made.irradiance.ravel() * (made.x[1] - made.x[0]) ** 2, where, 2)
    errors.append(np.abs(plain - truth).sum() / truth.sum())
    assert errors[0] < 2e-3 and errors[0] < 0.3 * errors[1]


def test_gathering_is_the_overlap_of_two_boxes():
    """A point source's share to a pixel is the area that a cell about it and the pixel have in common."""
    at = np.array([[0.25, -1.4], [0.0, 0.0], [7.0, 7.0]])
    out = gathered(np.array([2.0, 1.0, 5.0]), at, 3)
    expected = np.zeros((7, 7))
    expected[3, 3] = 1.0
    for dx, wx in ((0, 0.75), (1, 0.25)):
        for dy, wy in ((-2, 0.4), (-1, 0.6)):
            expected[3 + dy, 3 + dx] += 2.0 * wx * wy
    np.testing.assert_allclose(out, expected, atol=1e-15)


def test_a_field_of_directions_is_refused():
    field = fit_field(beam(0.1, sigma=np.array([SIGMA])))
    with pytest.raises(InputError, match="space"):
        source_amplitude(field, THETA, 1e-3, 1e-4, SIGMA)


def test_rays_of_a_pair_are_their_mutual_intensity_and_land_where_the_kernel_does():
    """Of two defocused beams: the sum over rays is J; the kernel by rays is that of diffraction, but for its rings."""
    m, l = pupil(14.0, 0.0), pupil(14.5, 0.0)  # noqa: E741
    points = sunflower(20_000)[: 20_000 - rim(20_000)] / 0.985
    product, power, direction, group = rays_of_pair(m, l, SIGMA, points)
    share = len(product) / len(points)
    assert share * np.pi * m.support.scale.prod() == pytest.approx(np.pi * RADIUS**2, rel=2e-3)
    truth = overlap(m, l, np.array([SIGMA]))
    exact = truth.value[0] * np.exp(2j * np.pi * SIGMA * truth.opd_m[0])
    total = power.sum(axis=0)
    assert product.sum() / np.sqrt(total[0] * total[1]) == pytest.approx(exact, abs=3e-3)
    one, two = amplitudes(m, l, reach=17.0)
    by_waves = cell_kernel(one.field * two.field.conj(), one.x, one.y, TO_PIXELS, 16) / m.power_at(np.array([SIGMA]))[0]
    where = (direction - THETA) @ TO_PIXELS.T
    by_rays = gathered(product / np.sqrt(total[0] * total[1]), where, 16)
    assert np.abs(by_waves - by_rays).sum() < 0.2
    assert np.abs(by_waves - by_rays.conj()).sum() > 0.8
    assert np.ptp(group) == pytest.approx(0.5 / SIGMA, rel=0.05)  # half a wave from the middle to the rim
