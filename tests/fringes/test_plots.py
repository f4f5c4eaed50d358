"""The picture shows the three curves on the OPD axis in mm."""

import matplotlib

matplotlib.use("Agg")

import numpy as np
from fringe_scenes import ROWS, SIGMA0, retro_family

from cgi_wave.fringes.plots import plot_psi
from cgi_wave.fringes.psi import synthesise


def test_plot_psi_draws_what_it_is_given():
    psi = synthesise(retro_family(1.33e-3, 0.045), np.array([SIGMA0]), np.ones(1), ROWS)
    ax = plot_psi(psi)
    assert "mm" in ax.get_xlabel()
    assert ax.get_ylabel()
    lines = ax.get_lines()
    np.testing.assert_array_equal(lines[0].get_xdata(), psi.opd_m * 1e3)
    np.testing.assert_array_equal(lines[0].get_ydata(), psi.nominal.irradiance)
    np.testing.assert_array_equal(lines[1].get_ydata(), psi.coherent.irradiance)
    (right,) = [other for other in ax.figure.axes if other is not ax]
    assert right.get_ylabel()
    for line, book in zip(right.get_lines(), (psi.coherent, psi.paper), strict=True):
        np.testing.assert_array_equal(line.get_ydata(), book.irradiance - psi.nominal.irradiance)
    assert len(ax.get_legend().get_texts()) == 4
    assert plot_psi(psi, ax) is ax
