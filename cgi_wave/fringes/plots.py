"""Pictures of interferograms. They compute nothing; matplotlib is imported when one is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgi_wave.fringes.psi import Psi

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_psi(result: Psi, ax: Axes | None = None) -> Axes:
    """Nominal, with-stray-light and parasitic interferogram against the nominal OPD in mm; returns the Axes."""
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(figsize=(8.0, 4.5), layout="constrained")
    opd_mm = result.opd_m * 1e3
    nominal = result.nominal.irradiance
    ax.plot(opd_mm, nominal, color="C0", label="nominal")
    ax.plot(opd_mm, result.coherent.irradiance, color="C3", label="with stray light")
    ax.plot(opd_mm, result.coherent.irradiance - nominal, color="C1", label="parasitic part, coherent")
    ax.plot(
        opd_mm, result.paper.irradiance - nominal, color="C2", ls="--", label="parasitic part, ghost–nominal pairs only"
    )
    ax.set_xlabel("OPD of the nominal beams (mm)")
    ax.set_ylabel("irradiance / input (dimensionless)")
    ax.ticklabel_format(axis="x", useOffset=False)
    ax.legend(loc="center right")
    return ax
