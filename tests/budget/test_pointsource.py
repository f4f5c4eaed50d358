"""Point-source contrast of real rays against closed forms: a plate's ghost, defocus; energy; γ beside J."""

from functools import partial

import numpy as np
import pytest
from chain_cases import (
    FOCAL,
    INDEX,
    NOMINAL,
    PLATE_GHOST,
    RADIUS,
    contrast,
    fresnel,
    landing,
    on_a_detector,
    parabola,
    plate_path,
    pupil_field,
    radial,
)
from scipy.optimize import brentq

from cgi_wave.budget.contrast import contrast_of
from cgi_wave.budget.pointfields import direction_field, fine_field, fine_rays, nominal_fields, without_directions
from cgi_wave.budget.pointsource import point_source
from cgi_wave.errors import CgiWaveError, FoldedFieldError, MethodLimitError
from cgi_wave.rays.beams import nominal_direction, rays_to_point, spot
from cgi_wave.rays.charts import rays_from_points
from cgi_wave.rays.paths import find_paths, parse_path
from cgi_wave.wave.field import power
from cgi_wave.wave.methods.incoherent import incoherent_overlap
from cgi_wave.wave.overlap import overlap
from cgi_wave.wave.overpupil import contrast_over_pupil

AXIS = np.zeros(2)


def fields(system):
    """Ghost of the plate and nominal beam, in direction cosines."""
    return [direction_field(system, parse_path(system, text), AXIS, AXIS) for text in (PLATE_GHOST, NOMINAL)]


def test_the_plates_ghost_is_found():
    found = [str(path) for path in find_paths(parabola(0.3))]
    assert found[0] == NOMINAL
    assert PLATE_GHOST in found


@pytest.mark.parametrize("edge_mm", [0.1, 0.3, 0.45])
def test_a_detectors_edge_takes_power_and_no_more(edge_mm):
    """The ghost's spot is 0.5 mm wide. The overlap in the plane stays that over the whole pupil, whatever of the ghost
    the detector catches; its power is that of the rays that land there."""
    system = parabola(3.0, edge_mm=edge_mm)
    ghost, nominal = parse_path(system, PLATE_GHOST), parse_path(system, NOMINAL)
    near = nominal_fields(system, nominal, AXIS, AXIS)
    angle = brentq(lambda a: landing(3.0, a) - edge_mm * 1e-3, 0.0, 0.2)
    share = (2 * FOCAL * np.tan(angle / 2) / RADIUS) ** 2
    want = radial(system, plate_path(3.0)) / np.sqrt(share)
    for here in (contrast_of(system, ghost, AXIS, AXIS, near), over_pupil(system, ghost, near, AXIS, AXIS)):
        assert abs(here.value - want) < here.error < 1e-4 * abs(want)


def test_the_plane_is_nearer_to_a_detector_than_rays_cut_at_its_edge():
    """∫ h_m h_l* over small detectors, summed with nothing stationary: no edge of theirs diffracts. What the plane has
    too much is the nominal rim's light beyond them, here at its worst: on the axis, both rims are one circle."""
    plane, cut = [], []
    for plate_mm in (2.9, 3.1):
        for edge_mm in (0.2, 0.25, 0.3):
            system = parabola(plate_mm, edge_mm=edge_mm)
            on_it, share = on_a_detector(system, plate_path(plate_mm), edge_mm * 1e-3)
            plane.append(abs(radial(system, plate_path(plate_mm)) - on_it) / abs(on_it))
            cut.append(abs(contrast(*fields(system), system.sigma0)[0] * np.sqrt(share) - on_it) / abs(on_it))
    assert np.mean(plane) < 0.6 * np.mean(cut)


@pytest.mark.parametrize("plate_mm", [0.02, 0.3, 1.0, 3.0])
def test_contrast_of_a_plates_ghost(plate_mm):
    """∫ exp(i2πσ·2nt cos θ′) over the pupil: 0.4 to 63 waves of defocus, modulus and phase, within the bound."""
    system = parabola(plate_mm)
    value, bound = contrast(*fields(system), system.sigma0)
    want = radial(system, plate_path(plate_mm))
    assert abs(value - want) < bound
    assert bound < 2e-5
    waves = plate_path(plate_mm)(0.0) - plate_path(plate_mm)(2 * np.arctan(RADIUS / (2 * FOCAL)))
    assert abs(value) < 1.05 / (np.pi * waves * system.sigma0)


def test_contrast_of_a_bare_plates_ghost():
    """With Fresnel's reflectance, which falls towards the rim: T² and T²R² along each ray."""
    system = parabola(0.05, coating="bare")
    value, bound = contrast(*fields(system), system.sigma0)

    def nominal(angle):
        return (1 - fresnel(angle)) ** 2

    want = radial(system, plate_path(0.05), lambda a: nominal(a) * fresnel(a) ** 2, nominal)
    even = radial(system, plate_path(0.05))
    assert abs(value - want) < bound
    # Unpolarised reflectance hardly changes within 7°: the check can fail, but only by a little.
    assert abs(value - want) < 1e-6 < 1e-5 < abs(value - even)


@pytest.mark.parametrize("place", [0.5, -0.5, -1.5])
def test_phase_does_not_depend_on_where_the_detector_stands(place):
    """Behind both foci, between them, before both: caustics crossed and the turn to directions make up for each other.

    The ghost's focus lies 2t/n before the nominal one; ``place`` is in that unit.
    """
    plate = 0.9
    system = parabola(plate, defocus_mm=2 * plate / INDEX * place, behind_mm=2.4)
    value, bound = contrast(*fields(system), system.sigma0)
    assert abs(value - radial(system, plate_path(plate))) < bound < 2e-5


@pytest.mark.parametrize("defocus_mm", [0.02, 0.1, 0.5])
def test_contrast_of_pure_defocus(defocus_mm):
    """Two detector distances apart: ∫ exp(i2πσ·z cos θ) exactly, |sinc(W020)| within the cone's 1e-6."""
    sharp, blurred = parabola(0.05), parabola(0.05, defocus_mm=defocus_mm)
    (_, a), (_, b) = fields(sharp), fields(blurred)
    value, bound = contrast(b, a, sharp.sigma0)
    distance = defocus_mm * 1e-3
    want = radial(sharp, lambda angle: distance * np.cos(angle))
    assert abs(value - want) < bound
    waves = distance * (1 - np.cos(2 * np.arctan(RADIUS / (2 * FOCAL)))) * sharp.sigma0
    assert abs(value) == pytest.approx(abs(np.sinc(waves)), abs=bound + 2e-6)


@pytest.mark.parametrize("plate_mm", [0.0125, 0.03, 0.1])
def test_a_fixed_point_and_a_point_source_agree(plate_mm):
    """A defocused ghost against a sharp nominal spot of the same magnification: J = γ.

    What parts them is the parabola's coma θD/(32F²) at the angle θ of the blur, which only J sees: 0.005 waves at
    0.6 waves of defocus.
    """
    system = parabola(plate_mm)
    gamma, _ = contrast(*fields(system), system.sigma0)
    both = [pupil_field(system, parse_path(system, text), AXIS, AXIS) for text in (PLATE_GHOST, NOMINAL)]
    j, _ = contrast(*both, system.sigma0)
    assert abs(j - gamma) < 6e-3
    assert 0.03 < abs(gamma) < 0.9


# ------------------------------------------------------------------------------------------------ energy


def sampled(paths, order, step, count):
    """Some ghosts of one order, strongest first."""
    return [path for path in paths if path.order == order][: step * count : step]


def test_power_of_the_field_is_the_power_of_the_rays(nir, paths):
    """∫|Â|² d²q over directions = the spot's power times the pupil's area, for nominal and ghosts.

    A beam that the stop alone cuts agrees within the field's bound; where other apertures cut, counting rays errs by
    the rays along the edge.
    """
    x0 = nir.field_points()[0]
    theta = nominal_direction(nir, paths[0], x0)
    area = np.pi * nir.pupil_radius**2
    compared = {0: 0, 1: 0, 2: 0}
    for path in [*paths[:2], *sampled(paths, 1, 7, 10), *sampled(paths, 2, 16, 10)]:
        try:
            here, relative = power(direction_field(nir, path, theta, x0))
        except CgiWaveError:
            continue
        rays = spot(nir, path, theta, nir.sigma0, 4000)
        count = len(rays.x)
        edge = 0.0 if count > 3800 else 0.9 * np.sqrt(2 * np.sqrt(np.pi * count)) / count
        assert here[0] / area == pytest.approx(rays.power, rel=relative + edge), path.label
        compared[path.order] += 1
    assert compared[0] == 2 and compared[1] >= 6 and compared[2] >= 6


def test_sum_over_rays_agrees_with_the_fitted_power(nir, paths):
    """The quick sum that stands in for beams without a field: within its error for each of more than 20 ghosts."""
    x0 = nir.field_points()[0]
    theta = nominal_direction(nir, paths[0], x0)
    compared = 0
    for path in [*sampled(paths, 1, 3, 24), *sampled(paths, 2, 8, 12)]:
        try:
            field = pupil_field(nir, path, x0, theta)
        except CgiWaveError:
            continue
        quick, error = rays_to_point(nir, path, x0, np.array([nir.sigma0]), theta).power()
        fitted, relative = power(field)
        assert abs(quick - fitted[0]) < error + relative * fitted[0], path.label
        assert error < 0.2 * quick
        compared += 1
    assert compared > 20


# ------------------------------------------------------------------------------------------------ contrasts


def test_contrasts_of_the_reference_instrument(nir, paths):
    """Every contrast is at most one and its own bound; refused ones say why; the filter's ghost is far out of focus."""
    x0 = nir.field_points()[0]
    some = [*paths[:2], *sampled(paths, 1, 3, 12), *sampled(paths, 2, 40, 6)]
    found = point_source(nir, some, nominal_direction(nir, paths[0], x0), x0)
    contrasts = {}
    for ghost in found.ghosts:
        if ghost.contrast is None:
            assert ghost.error is None and len(ghost.method) > 10
            continue
        assert 0.0 <= ghost.contrast <= 1.0 + ghost.error
        assert 0.0 < ghost.error < 0.05
        contrasts[ghost.path.label] = ghost.contrast
    assert len(contrasts) > 12
    assert contrasts["filter_front:r arms 2-1"] < 0.01


# ------------------------------------------------------------------------------------------------ over the pupil


def over_pupil(system, path, other, theta, x0):
    trace = partial(rays_from_points, system, path, theta, x0, system.sigma0)
    return contrast_over_pupil(trace, system.pupil_radius, other, system.sigma0, path.label, 3e-7)


def test_over_the_pupil_over_directions_and_the_other_way_round(nir, paths):
    """Ghosts that have both: one number, within both bounds, its conjugate with the beams exchanged, and bounded."""
    x0 = nir.field_points()[0]
    theta = nominal_direction(nir, paths[0], x0)
    nominal = nominal_fields(nir, paths[0], theta, x0)
    sigma = np.array([nir.sigma0])
    for path in sampled(paths, 1, 11, 3):
        whole = fine_field(nir, path, theta, x0, fine_rays(nir, path, theta, x0))
        ghost = whole.field
        pair = overlap(ghost, nominal(0.0), sigma, 3e-7)
        on_it = 1.0 / np.sqrt(whole.caught)
        straight = pair.value[0] * np.exp(2j * np.pi * nir.sigma0 * pair.opd_m[0]) * on_it
        here = over_pupil(nir, path, nominal, theta, x0)
        back = over_pupil(nir, paths[0], lambda bend, ghost=ghost: ghost, theta, x0)
        assert here.bend == back.bend == 0.0
        assert abs(here.value - straight) < here.error + on_it * pair.error_bound[0] < 2e-6, path.label
        assert abs(on_it * back.value.conjugate() - here.value) < here.error + on_it * back.error < 2e-6, path.label
        assert 0.0 < abs(here.value) < 1.0
        if abs(here.value) > 1e-3:  # a few waves: the rest takes seconds
            loose = incoherent_overlap(ghost, nominal(0.0), nir.sigma0, 1e-2)
            assert abs(here.value) < loose.value + loose.error


@pytest.mark.parametrize(
    "band, name, why",
    [("NIR", "L3_front", "open"), ("SWIR2", "L3_front", "Fresnel number"), ("SWIR2", "L1_back", "Fresnel number")],
)
def test_crowded_and_collimated_ghosts_have_a_contrast(instrument, band, name, why):
    """Directions that crowd beyond a polynomial: cut. A beam nearly collimated at the detector: a bent chart."""
    system = instrument.band(band)
    found = find_paths(system, min_power=1e-4, probes=128)
    path = next(path for path in found if path.history == ((name, "reflect"),))
    x0 = system.field_points()[0]
    theta = nominal_direction(system, found[0], x0)
    with pytest.raises((FoldedFieldError, MethodLimitError), match=why):
        direction_field(system, path, theta, x0)
    told = without_directions(system, [found[0], path], theta, x0)  # by rays alone, before anything is fitted
    assert ("Fresnel" not in why and not told) or (list(told) == [path.label] and why in told[path.label])
    here = contrast_of(system, path, theta, x0, nominal_fields(system, found[0], theta, x0))
    assert here.method.startswith("over the ghost's pupil")
    assert 1e-4 < abs(here.value) < 2e-3
    if "lens" in here.method:
        assert here.error < 0.5 * abs(here.value)
    else:
        assert here.error < 1e-6
