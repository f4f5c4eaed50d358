"""Plots show the numbers they are given, in the units on their axes, on the axes they are given."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from cgi_wave.report import plots

GHOSTS = [
    {"order": 1, "contrast_eq4": 1e-2, "contrast": 2e-3, "contrast_error": 1e-5},
    {"order": 2, "contrast_eq4": 0.1, "contrast": 0.05, "contrast_error": 1.0},
    {"order": 2, "contrast_eq4": 0.1, "contrast": None, "contrast_error": None},
]
SPOT = {
    "label": "g", "power": 0.02, "rms_x_m": 1e-4, "rms_y_m": 2e-4,
    "x_m": [0, 1e-3, 2e-3], "y_m": [0, 1e-3], "irradiance": [[1.0e6, 3.0e6]],
}  # fmt: skip
PSF = {
    "label": "g", "share": 0.98, "method": "padded FFT",
    "x_m": [-1e-6, 1e-6], "y_m": [0, 2e-6], "psf": [[0.0, 4.0], [2.0, 1e-30]],
}  # fmt: skip
LAYOUT = {
    "title": "VIS/NIR",
    "axes": ("z", "y"),
    "surfaces": [
        {"name": "L1", "points_m": [[0, -0.01], [0, 0.01]], "name_at_m": [0, 0.01], "outward": [0.0, 1.0]},
        {"name": "", "points_m": [[0.01, -0.01], [0.01, 0.01]]},
    ],
    "rays": [{"points_m": [[-0.1, 0], [0, 0], [0.1, 0.01]], "group": 0}],
}
CASES = [
    (plots.plot_contrast, GHOSTS),
    (plots.plot_irradiance, SPOT),
    (plots.plot_psf, PSF),
    (plots.plot_layout, LAYOUT),
]


@pytest.fixture
def ax():
    figure, axes = plt.subplots()
    yield axes
    plt.close(figure)


@pytest.mark.parametrize(("plot", "result"), CASES)
def test_draws_on_the_given_axes_or_makes_its_own_and_labels_units(plot, result, ax):
    assert plot(result, ax=ax) is ax
    made = plot(result)
    assert made is not ax
    for label in (made.get_xlabel(), made.get_ylabel()):
        assert " / " in label or "dimensionless" in label
    made.figure.canvas.draw()
    plt.close(made.figure)


def test_contrast_is_log_log_with_bars_that_stay_on_the_axis(ax):
    plots.plot_contrast(GHOSTS, ax=ax)
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    bars = [container.lines[2][0].get_segments()[0] for container in ax.containers]
    np.testing.assert_allclose(bars[0][:, 1], [2e-3 - 1e-5, 2e-3 + 1e-5])
    np.testing.assert_allclose(bars[1][:, 1], [0.05 * 0.01, 1.05])
    assert "1 without a contrast" in [text.get_text() for text in ax.get_legend().get_texts()]
    diagonal = next(line for line in ax.lines if line.get_label() == "1:1")
    np.testing.assert_array_equal(diagonal.get_xdata(), diagonal.get_ydata())


def test_contrast_of_no_ghosts_is_an_empty_picture(ax):
    assert plots.plot_contrast([], ax=ax).get_legend() is None


def test_lengths_are_shown_in_the_unit_of_the_label(ax):
    plots.plot_layout(LAYOUT, ax=ax)
    np.testing.assert_allclose(ax.lines[0].get_xdata(), [-100.0, 0.0, 100.0])
    assert ax.get_xlabel() == "z / mm"


def test_psf_is_relative_to_its_peak_and_its_dark_is_the_end_of_the_scale(ax):
    plots.plot_psf(PSF, ax=ax)
    (image,) = ax.images
    np.testing.assert_allclose(np.asarray(image.get_array()), [[0.0, 1.0], [0.5, 2.5e-31]])
    assert (image.norm.vmin, image.norm.vmax) == (1e-6, 1.0)
    assert image.norm(1e-30) == image.norm(1e-6) == 0.0
    np.testing.assert_allclose(image.get_extent(), [-2.0, 2.0, -1.0, 3.0])  # pixels of 2 µm about their samples
    assert ax.get_title() == "g\n98.0% of its power in the window"


def test_a_geometric_picture_says_so(ax):
    plots.plot_psf(PSF | {"share": None, "method": "geometric (too steep)"}, ax=ax)
    assert ax.get_title() == "g\ngeometric"


def test_irradiance_starts_at_zero_so_that_maps_compare(ax):
    plots.plot_irradiance(SPOT, ax=ax)
    (mesh,) = ax.collections
    assert mesh.norm.vmin == 0.0 and mesh.norm.vmax == pytest.approx(3.0)  # 3e6 per m² is 3 per mm²
    assert ax.get_title() == "g\npower 0.02, RMS 100 × 200 µm"


@pytest.mark.parametrize(("count", "cells"), [(1, 1), (4, 4), (5, 8), (0, 1)])
def test_grid_has_a_picture_for_each_and_hides_the_rest(count, cells):
    figure = plots.grid(plots.plot_psf, [PSF] * count)
    titled = [axes for axes in figure.axes if axes.get_title().startswith("g\n")]
    off = [axes for axes in figure.axes if not axes.axison]
    assert (len(titled), len(off)) == (count, cells - count)
