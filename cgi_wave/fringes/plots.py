"""Pictures of interferograms. They compute nothing; matplotlib is imported when one is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgi_wave.fringes.psi import Psi

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_psi(result: Psi, ax: Axes | None = None) -> Axes:
    """Nominal and with-stray-light interferogram against the nominal OPD in mm; returns the Axes.

    The parasitic part of both book-keepings, a hundred times smaller, has an axis of its own on the right.
    """
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(figsize=(8.0, 4.5), layout="constrained")
    opd_mm = result.opd_m * 1e3
    nominal = result.nominal.irradiance
    ax.plot(opd_mm, nominal, color="C0", label="nominal")
    ax.plot(opd_mm, result.coherent.irradiance, color="C3", label="with stray light")
    ax.set_xlabel("OPD of the nominal beams (mm)")
    ax.set_ylabel("irradiance / input (dimensionless)")
    ax.ticklabel_format(axis="x", useOffset=False)
    right = ax.twinx()
    right.plot(opd_mm, result.coherent.irradiance - nominal, color="C1", lw=1.0, label="parasitic, all pairs (right)")
    right.plot(
        opd_mm, result.paper.irradiance - nominal, color="C2", lw=1.0, ls="--",
        label="parasitic, ghost–nominal pairs only (right)",
    )  # fmt: skip
    right.set_ylabel("parasitic part / input (dimensionless)")
    lines = [*ax.get_lines(), *right.get_lines()]
    ax.legend(lines, [str(line.get_label()) for line in lines], loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2,
              frameon=False)  # fmt: skip
    return ax
