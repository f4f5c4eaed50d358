"""Gas columns as spectral modes, and plumes: held-out columns, Beer's law, mass."""

from __future__ import annotations

import numpy as np
import pytest
from ground_cases import NIR, canvas, flat

from cgi_wave.errors import InputError, MethodLimitError
from cgi_wave.scene.atmosphere import column_mass, optical_depth, standard_atmosphere
from cgi_wave.scene.builders import edge, uniform
from cgi_wave.scene.column import column_modes, with_column
from cgi_wave.scene.oxygen import oxygen_a_band
from cgi_wave.scene.plume import Plume, with_plume
from cgi_wave.scene.radiance import gas_lines, toa_radiance
from cgi_wave.scene.spectrum import Spectrum


@pytest.fixture(scope="module")
def oxygen():
    """Radiance through the A band at air mass 2, and the optical depth in it, at every sixth sample: quicker."""
    fine = toa_radiance("o2a", NIR, 2e-3)
    spectrum = Spectrum(fine.sigma[::6], fine.radiance[::6], fine.source)
    return spectrum, 2 * optical_depth(gas_lines("o2a", NIR), spectrum.sigma, standard_atmosphere(8))


def relative_error(modes, spectrum, depth, excess):
    """∫F|L − Σ| / ∫F L₀ at one excess, by Beer's law."""
    passed = NIR.transmission(spectrum.sigma)
    exact = spectrum.radiance * np.expm1(-depth * excess)
    left = exact - modes.weights(np.array(excess)).astype(float) @ modes.shapes
    return passed @ np.abs(left) / (passed @ spectrum.radiance)


@pytest.mark.parametrize(("low", "high"), [(0.0, 0.05), (-0.3, 0.05), (-0.2, 0.6), (0.0, 3.0)])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_residual_holds_at_columns_that_nobody_sampled(oxygen, low, high, tolerance):
    spectrum, depth = oxygen
    modes = column_modes(spectrum.sigma, spectrum.radiance, depth, NIR, low, high, tolerance)
    drawn = np.random.default_rng(5).uniform(low, high, 25)
    worst = max(relative_error(modes, spectrum, depth, e) for e in [*drawn, low, high])
    assert worst <= modes.residual <= tolerance
    assert modes.residual < 100 * worst  # a bound, not an excuse


def test_rank_is_the_smallest_that_keeps_the_tolerance(oxygen):
    """Finer tolerances take more modes; one mode fewer would not have done."""
    spectrum, depth = oxygen
    rank = [
        len(column_modes(spectrum.sigma, spectrum.radiance, depth, NIR, 0.0, 0.5, t).shapes) for t in (1e-2, 1e-4, 1e-6)
    ]
    assert rank == sorted(set(rank))
    modes = column_modes(spectrum.sigma, spectrum.radiance, depth, NIR, 0.0, 0.5, 1e-6)
    last = np.abs(NIR.transmission(spectrum.sigma) @ np.abs(modes.shapes[-1]))
    assert last / (NIR.transmission(spectrum.sigma) @ spectrum.radiance) > 1e-6


def test_scene_obeys_beer_pixel_by_pixel(oxygen):
    """Albedo and column vary apart from each other; the column's change is that of the transmission itself."""
    spectrum, depth = oxygen
    ground = edge(canvas(spectrum), 3, 5, contrast=4, angle_deg=30)
    factor = np.linspace(0.9, 1.3, 15).reshape(3, 5)
    scene = with_column(ground, factor - 1, depth, NIR)
    assert scene.rank_residual <= 1e-6
    assert np.array_equal(scene.maps[0], ground.maps[0])
    assert np.array_equal(scene.shapes[0], spectrum.radiance)
    passed = NIR.transmission(spectrum.sigma)
    for row, column in ((0, 0), (1, 3), (2, 4)):
        lit = float(ground.maps[0, row, column])
        exact = lit * spectrum.radiance * np.exp(-depth * (factor[row, column] - 1))
        error = passed @ np.abs(scene.spectrum(row, column).radiance - exact)
        assert error <= 1.2e-6 * lit * (passed @ spectrum.radiance)  # maps in float32 take the last 2e-7


def test_a_higher_column_is_a_larger_air_mass(oxygen):
    """The same radiance as that computed with the air mass itself, but for the sun's height."""
    spectrum, depth = oxygen
    scene = with_column(uniform(canvas(spectrum), 1, 1), np.array([[0.2]]), depth, NIR)
    direct = toa_radiance("o2a", NIR, 2e-3, air_mass=2.4)
    assert scene.spectrum(0, 0).radiance == pytest.approx(
        direct.radiance[::6] * 1.4, abs=2e-7 * spectrum.radiance.max(), rel=1e-6
    )


def test_a_gray_gas_takes_one_mode():
    spectrum = flat()
    scene = with_column(uniform(canvas(spectrum), 1, 3), np.array([[0.0, 0.5, 1.0]]), np.full(11, 0.7), NIR)
    assert len(scene.maps) == 2
    assert [scene.spectrum(0, i).radiance[5] for i in range(3)] == pytest.approx(np.exp([0, -0.35, -0.7]), rel=1e-6)


def test_no_excess_changes_nothing(oxygen):
    scene = uniform(canvas(oxygen[0]), 2, 2)
    assert with_column(scene, np.zeros((2, 2)), oxygen[1], NIR) is scene


@pytest.mark.parametrize(
    ("direction", "width", "length", "spread"),
    [(30.0, 300.0, 500.0, 0.1), (215.0, 40.0, 500.0, 0.05), (0.0, 200.0, 150.0, 0.0)],
)
def test_plume_holds_the_declared_mass(direction, width, length, spread):
    plume = Plume((100.0, -40.0), direction, width, length, spread, mass_kg=5e4)
    column = plume.column(320, 320, 75.0)
    assert column.min() >= 0
    assert column.sum() * 75.0**2 == pytest.approx(5e4, rel=1e-5)


def test_plume_has_the_declared_peak_and_blows_where_declared():
    """Peak in pixels much smaller than the plume; centre of mass at the mean distance, length, downwind."""
    plume = Plume(direction_deg=90.0, width_m=400.0, length_m=1500.0, spread=0.1, peak_kg_m2=0.02)
    assert plume.column(400, 60, 20.0).max() == pytest.approx(0.02, rel=1e-3)
    column = plume.column(900, 300, 75.0)
    y, x = (np.arange(900) - 449.5) * 75.0, (np.arange(300) - 149.5) * 75.0
    total = column.sum()
    assert column.sum(axis=1) @ y / total == pytest.approx(1500.0, rel=1e-4)
    assert column.sum(axis=0) @ x / total == pytest.approx(0.0, abs=1e-6)
    assert plume.mass() == pytest.approx(total * 75.0**2, rel=1e-5)
    # Far from the source the crosswind profile is the Gaussian that was declared.
    row = column[int(449.5 + 4000 / 75)]
    deviation = np.sqrt(row @ x**2 / row.sum())
    distance = y[int(449.5 + 4000 / 75)]
    assert deviation == pytest.approx(np.hypot(400.0, 0.1 * distance), rel=3e-3)


def test_background_column_of_oxygen_is_its_share_of_the_surface_pressure():
    air = 101325.0 / 9.80665
    assert column_mass(oxygen_a_band(), standard_atmosphere(8)) == pytest.approx(
        0.20946 * 31.98983e-3 / 0.0289644 * air, rel=1e-4
    )


def test_plumes_add_up_over_the_background(oxygen):
    spectrum, depth = oxygen
    plumes = [Plume((x, -400.0), peak_factor=0.1, width_m=200.0, length_m=900.0) for x in (-300.0, 300.0)]
    ground = uniform(canvas(spectrum), 20, 24)
    scene = with_plume(ground, plumes, depth, 2400.0, NIR)
    column = sum(plume.column(20, 24, 75.0, 2400.0) for plume in plumes) / 2400.0
    row, col = np.unravel_index(column.argmax(), column.shape)
    exact = spectrum.radiance * np.exp(-depth * column[row, col])
    passed = NIR.transmission(spectrum.sigma)
    assert passed @ np.abs(scene.spectrum(row, col).radiance - exact) <= 1.2e-6 * (passed @ spectrum.radiance)
    assert "% of it in the scene" in scene.source


def test_too_coarse_a_set_of_columns_is_a_named_limit(oxygen):
    spectrum, depth = oxygen
    with pytest.raises(MethodLimitError, match="narrow the range"):
        column_modes(spectrum.sigma, spectrum.radiance, depth, NIR, 0.0, 1e7, 1e-7)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"depth": np.ones(3)}, "depth"),
        ({"depth": -np.ones(11)}, "depth"),
        ({"depth": np.full(11, np.nan)}, "depth"),
        ({"excess": np.ones((2, 2))}, "excess"),
        ({"excess": np.array([[0.0, np.nan, 1.0]])}, "excess"),
        ({"tolerance": 1e-9}, "tolerance"),
    ],
)
def test_column_that_cannot_be_is_refused(change, field):
    given = {"excess": np.array([[0.0, 0.5, 1.0]]), "depth": np.ones(11), **change}
    with pytest.raises(InputError) as caught:
        with_column(uniform(canvas(flat()), 1, 3), band_filter=NIR, **given)
    assert caught.value.field == field


def test_light_that_the_background_has_swallowed_cannot_come_back(oxygen):
    """Line cores underflow to zero; with nearly all gas gone they would shine again."""
    spectrum, depth = oxygen
    assert (spectrum.radiance == 0).any()
    with pytest.raises(InputError, match="less gas lets light through"):
        column_modes(spectrum.sigma, spectrum.radiance, depth, NIR, -0.99, 0.0)


def test_a_second_column_is_refused_with_the_way_out(oxygen):
    scene = with_column(uniform(canvas(oxygen[0]), 1, 2), np.array([[0.0, 0.1]]), oxygen[1], NIR)
    with pytest.raises(InputError, match="apply the sum once"):
        with_column(scene, np.array([[0.0, 0.1]]), oxygen[1], NIR)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"width_m": 0.0}, "width_m"),
        ({"length_m": np.inf}, "length_m"),
        ({"spread": -0.1}, "spread"),
        ({"direction_deg": np.nan}, "at_m, direction_deg"),
        ({"mass_kg": None}, "mass_kg, peak_kg_m2, peak_factor"),
        ({"peak_factor": 1.0}, "mass_kg, peak_kg_m2, peak_factor"),
        ({"mass_kg": -1.0}, "mass_kg"),
    ],
)
def test_plume_that_cannot_be_is_refused(change, field):
    with pytest.raises(InputError) as caught:
        Plume(**{"mass_kg": 1.0, **change})
    assert caught.value.field == field
    with pytest.raises(InputError, match="background"):
        Plume(peak_factor=0.1).column(2, 2, 75.0)
