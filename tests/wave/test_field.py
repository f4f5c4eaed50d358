"""Fitting traced samples: power, support, folds, refusals."""

import dataclasses

import numpy as np
import pytest
from synthetic_beams import SIGMA, beam, cloud, disc, hole

from cgi_wave.errors import EmptyBeamError, FoldedFieldError, InputError, MethodLimitError
from cgi_wave.wave.basis import at_points, chebyshev_wavenumbers
from cgi_wave.wave.field import fit_field, power
from cgi_wave.wave.fold import COLLAPSE_LIMIT, check_map


def test_power_is_the_integral_of_the_squared_amplitude():
    # integral over the unit disc of (1 + x/2)² = pi (1 + 1/16)
    value, error = power(fit_field(beam(amplitude=lambda x, y: 1 + 0.5 * x)))
    assert abs(value[0] / (np.pi * 17 / 16) - 1) <= error + 1e-14
    assert error < 1e-9


def test_power_of_a_gaussian_amplitude_within_its_error():
    value, error = power(fit_field(beam(amplitude=lambda x, y: np.exp(-(x**2 + y**2)))))
    exact = np.pi * (1 - np.exp(-2.0)) / 2
    assert abs(value[0] / exact - 1) <= error < 1e-3


def test_power_follows_the_amplitude_over_wavenumbers():
    sigma = chebyshev_wavenumbers(0.9 * SIGMA, 1.1 * SIGMA, 3)
    samples = beam(sigma=sigma)
    scaled = dataclasses.replace(samples, amplitude=samples.amplitude * (sigma / SIGMA)[:, None])
    field = fit_field(scaled)
    at = np.array([0.9, 1.04, 1.1]) * SIGMA
    np.testing.assert_allclose(field.power_at(at), np.pi * (at / SIGMA) ** 2, rtol=1e-9)


def test_an_aperture_that_no_polynomial_fits_is_within_its_error():
    value, error = power(fit_field(beam(clearances=[lambda x, y: 1 - np.sqrt((x**2 + y**2 + 0.3) / 1.3)])))
    assert 1e-12 < abs(value[0] / np.pi - 1) <= error < 1e-3


def test_a_bar_leaves_two_pieces():
    value, _ = power(fit_field(beam(clearances=[disc(), lambda x, y: (x - 0.1) ** 2 - 0.15**2])))
    strip = [x * np.sqrt(1 - x * x) + np.arcsin(x) for x in (-0.05, 0.25)]
    assert value[0] == pytest.approx(np.pi - (strip[1] - strip[0]), rel=1e-9)


def random_aperture(rng):
    """A disc with up to three random cuts: holes, straight edges, bars, ellipses."""
    stops = [disc(rng.uniform(0.7, 1.0), *rng.uniform(-0.1, 0.1, 2))]
    for kind in rng.integers(0, 4, rng.integers(1, 4)):
        angle, offset, width = rng.uniform(0, 6.3), rng.uniform(-0.2, 0.5), rng.uniform(0.1, 0.3)
        c, s = np.cos(angle), np.sin(angle)
        stops.append(
            [
                hole(width, *rng.uniform(-0.5, 0.5, 2)),
                lambda x, y, c=c, s=s, b=offset: b - x * c - y * s,
                lambda x, y, c=c, s=s, b=offset, w=width: (b - x * c - y * s) ** 2 - w * w,
                lambda x, y, w=width: 1 - (x / (3 * w)) ** 2 - y**2,
            ][kind]
        )
    return stops


def test_no_piece_of_a_random_aperture_is_missed():
    axis = (np.arange(800) + 0.5) / 400 - 1.0
    x, y = np.meshgrid(1.1 * axis, 1.1 * axis)
    rng = np.random.default_rng(11)
    for _ in range(25):
        stops = random_aperture(rng)
        lit = np.all([c(x, y) > 0 for c in stops], axis=0)
        if lit.mean() > 0.05:
            area = lit.sum() * (1.1 / 400) ** 2
            assert power(fit_field(beam(clearances=stops, count=1200)))[0][0] == pytest.approx(area, abs=2e-3)


def test_degree_is_chosen_by_the_held_out_misfit():
    smooth, rough = fit_field(beam(lambda x, y: x**2)), fit_field(beam(lambda x, y: np.sin(5 * x + 2 * y)))
    assert smooth.degree == 4 and rough.degree > 10
    # the stated misfit covers the true one between the samples
    u = cloud(0.98, 2000)
    points = (u - rough.support.centre) / rough.support.scale
    true = np.sin(5 * u[:, 0] + 2 * u[:, 1]) / SIGMA
    assert np.abs(at_points(rough.opl[0], points) - true).max() <= rough.opl_residual < 1e-3 / SIGMA


def test_clearances_that_never_cut_are_dropped():
    field = fit_field(beam(clearances=[disc(), disc(3.0), lambda x, y: 5 + np.sin(9 * x)]))
    assert field.support.clearance.shape[0] == 1


def test_anamorphic_beam_keeps_its_shape():
    narrow = [lambda x, y: 1 - x**2 - (y / 0.02) ** 2]
    samples = beam(clearances=narrow)
    squeezed = dataclasses.replace(samples, u=samples.u * [1.0, 0.02])
    x, y = squeezed.u[0].T
    squeezed = dataclasses.replace(squeezed, clearance=narrow[0](x, y)[None, None], direction=squeezed.u)
    assert power(fit_field(squeezed))[0][0] == pytest.approx(np.pi * 0.02, rel=1e-9)


def test_wavenumbers_with_points_of_their_own():
    """Directions move with the wavenumber: one fit each, and the edge's change is in its residual."""
    sigma = chebyshev_wavenumbers(0.9 * SIGMA, 1.1 * SIGMA, 3)
    move = 1e-3 * (sigma / SIGMA - 1.0)
    same = beam(lambda x, y: np.sin(3.0 * x + y), sigma=sigma)
    x, y = np.moveaxis(same.u + move[:, None, None], 2, 0)
    moved = dataclasses.replace(
        same, u=same.u + move[:, None, None], opl=np.sin(3.0 * x + y) / SIGMA, clearance=(1.0 - x**2 - y**2)[None]
    )
    plain = fit_field(same)
    for field in (plain, fit_field(moved)):
        points = cloud(0.98, 500)
        found = at_points(field.opl, (points - field.support.centre) / field.support.scale)
        off = np.abs(found - np.sin(3.0 * points[:, 0] + points[:, 1]) / SIGMA).max()
        assert off <= field.opl_residual < 1e-6 / SIGMA
        assert abs(field.degree - plain.degree) <= 2
    still = dataclasses.replace(moved, clearance=same.clearance)  # the same rays pass, and end elsewhere
    shifted = fit_field(still).support.residual
    assert fit_field(moved).support.residual.max() < 1e-12
    assert shifted.max() == pytest.approx(2.0 * np.sqrt(2.0) * move[-1], rel=0.1)


def test_a_value_that_is_not_finite_is_named():
    for name in ("opl", "amplitude", "clearance", "u"):
        samples = beam()
        bad = getattr(samples, name).copy()
        bad.flat[3] = np.nan
        with pytest.raises(InputError, match=name):
            fit_field(dataclasses.replace(samples, **{name: bad}))


def test_empty_sparse_and_open_beams_are_refused():
    with pytest.raises(EmptyBeamError):
        fit_field(beam(clearances=[lambda x, y: -1 - x**2]))
    with pytest.raises(MethodLimitError, match="lit samples"):
        fit_field(beam(clearances=[disc(0.1)], count=300))
    with pytest.raises(MethodLimitError, match="degree"):
        fit_field(beam(count=60), degree=12)
    with pytest.raises(MethodLimitError, match="edge of the sampled domain"):
        fit_field(beam(clearances=[lambda x, y: 0.5 - x]))  # nothing bounds it on three sides


def focus(p, f):
    return -p / f


def test_jacobian_of_a_focused_beam():
    p = cloud(0.016, 400)
    det = check_map(p, focus(p, 0.13) + 2.0 * p * (p**2).sum(axis=1)[:, None], 1e6)
    radial = -1 / 0.13 + 2.0 * (p**2).sum(axis=1)
    exact = radial * (radial + 4.0 * (p**2).sum(axis=1))
    np.testing.assert_allclose(det, exact, rtol=1e-8)


def test_fold_and_collapse_are_refused():
    p = cloud(0.016, 400)
    folded = focus(p, 0.13)
    folded[:, 0] = p[:, 0] ** 2 / 0.13  # turns back at x = 0
    with pytest.raises(FoldedFieldError, match="changes sign"):
        check_map(p, folded, 1e6)
    with pytest.raises(FoldedFieldError, match=f"below {COLLAPSE_LIMIT:g}"):
        check_map(p, focus(p, 1e4), 1e6)
    # one direction collimated, the other not, is as little a field of directions
    line = focus(p, 0.13)
    line[:, 1] = 0.0
    with pytest.raises(FoldedFieldError):
        check_map(p, line, 1e6)


def test_clearances_in_the_shadow_of_others_are_dropped_and_change_nothing():
    """A circle cut by a straight edge; circles 2 to 6 % wider bound nothing, one that cuts a corner does."""
    own = [disc(1.0), lambda x, y: 0.6 - x + 0.1 * y]
    wider = [disc(1.0 + 0.02 * k) for k in (1, 2, 3)]
    corner = [lambda x, y: 1.31 - x - y]
    plain = fit_field(beam(amplitude=lambda x, y: 1.0 + 0.3 * x, clearances=own + corner))
    crowded = fit_field(beam(amplitude=lambda x, y: 1.0 + 0.3 * x, clearances=own + wider + corner))
    assert len(plain.support.clearance) == len(crowded.support.clearance) == 3
    np.testing.assert_allclose(power(crowded)[0], power(plain)[0], rtol=1e-12)


def test_a_clearance_that_cuts_by_little_is_kept():
    """Of five circles the innermost reaches 1 % further than the others in one place, and less in the rest."""
    circles = [disc(1.0, 0.05 * np.cos(a), 0.05 * np.sin(a)) for a in (0.0, 1.3, 2.5, 3.8, 5.0)]
    field = fit_field(beam(clearances=circles))
    assert len(field.support.clearance) == 5
