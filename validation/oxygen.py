"""The computed O2 A band beside a published line list.

    python -m validation.oxygen O2_ABand_Drouin_2017_linelist.csv

The list is that of Drouin et al., JQSRT 186, 118 (2017), in the CSV layout of the NIST MATS repository
(https://github.com/usnistgov/MATS, free use with notice; not shipped here). Prints, branch by branch, the residuals of
position and lower energy and the ratio of intensities, then the widths, then what both lists make of the coherent rise.
"""

from __future__ import annotations

import argparse
import csv
import re
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cgi_wave.report.output import to_json
from cgi_wave.scene.atmosphere import transmission
from cgi_wave.scene.coherence import coherence, coherent_rise
from cgi_wave.scene.filters import Filter
from cgi_wave.scene.lines import LineList
from cgi_wave.scene.oxygen import air_half_width, oxygen_a_band
from cgi_wave.scene.radiance import solar_irradiance, toa_radiance
from cgi_wave.scene.spectrum import Spectrum
from validation.study_page import table

ATM_PA = 101325.0
STRONG = 1e-26  # cm/molecule: lines below do not show at any OPD


def read_list(path: Path) -> tuple[LineList, np.ndarray]:
    """All lines of the file (isotopologues and hot bands too) and which of them are magnetic-dipole ¹⁶O2 0–0 lines."""
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    local = [re.match(r"[\s,]*([A-Z])\s*(\d+)([A-Z])\s*(\d+)\s*([dq])", row["local_lower_quanta"]) for row in rows]
    main = np.array(
        [
            row["local_iso_id"] == "1"
            and row["global_upper_quanta"].split()[-1] == "0"
            and m is not None
            and m[5] == "d"
            for row, m in zip(rows, local, strict=True)
        ]
    )
    reference = oxygen_a_band()

    def column(name: str, scale: float) -> np.ndarray:
        return np.array([float(row[name]) for row in rows]) * scale

    lines = LineList(
        branch=np.array([m[1] + m[3] if m else "" for m in local]),
        n_lower=np.array([int(m[2]) if m else -1 for m in local]),
        j_lower=np.array([int(m[4]) if m else -1 for m in local]),
        sigma=column("nu", 1e2),
        strength=column("sw", 1e-2),
        lower_energy=column("elower", 1e2),
        half_width=column("gamma0_air", 1e2 / ATM_PA),
        exponent=column("n_gamma0_air", 1.0),
        mass_kg=reference.mass_kg,
        mole_fraction=reference.mole_fraction,
        partition=reference.partition,
        source=path.name,
    )
    return lines, main


def compare_lines(published: LineList, main: np.ndarray) -> dict[str, Any]:
    """Positions (cm⁻¹), lower energies (cm⁻¹) and intensities by branch, the band's intensity, widths (per J″)."""
    computed = oxygen_a_band()
    key = {(b, int(n)): i for i, (b, n) in enumerate(zip(computed.branch, computed.n_lower, strict=True))}
    branches = []
    for branch in ("PP", "PQ", "RR", "RQ"):
        theirs = np.flatnonzero(main & (published.branch == branch) & (published.strength > STRONG / 100))
        ours = np.array([key[branch, int(published.n_lower[i])] for i in theirs])
        position = (computed.sigma[ours] - published.sigma[theirs]) / 100
        energy = np.abs(computed.lower_energy[ours] - published.lower_energy[theirs]).max() / 100
        ratio = computed.strength[ours] / published.strength[theirs]
        branches.append({
            "branch": branch, "lines": theirs.size, "position_rms": np.sqrt(np.mean(position**2)),
            "position_largest": np.abs(position).max(), "energy_largest": energy, "intensity_least": ratio.min(),
            "intensity_mean": np.average(ratio, weights=published.strength[theirs]), "intensity_most": ratio.max(),
        })  # fmt: skip
    # The dipole lines of this file carry widths rounded to 0.01; its quadrupole lines carry four digits, one per level.
    fine = np.flatnonzero(~main & (published.branch == "RS"))
    ratio = air_half_width(published.j_lower[fine]) / published.half_width[fine]
    return {
        "branches": branches,
        "band_intensity_cm": {
            "computed": computed.strength.sum() * 100, "published": published.strength[main].sum() * 100,
            "whole_file": published.strength.sum() * 100,
        },
        "half_width_ratio": {str(j): r for j, r in zip(published.j_lower[fine], ratio, strict=True)},
    }  # fmt: skip


def compare_rises(published: LineList) -> list[dict[str, Any]]:
    """Where the coherence peaks with either list, its NMA there, and how far the two curves part."""
    rows = []
    shapes: tuple[tuple[float, float, Literal["flat-top", "gaussian"]], ...] = (
        (764.0, 2.6, "flat-top"),
        (764.0, 2.6, "gaussian"),
        (764.5, 3.5, "flat-top"),
    )
    for centre, fwhm, shape in shapes:
        band = Filter(centre * 1e-9, fwhm * 1e-9, shape)
        computed = toa_radiance("o2a", band, 6e-3)
        sun = 0.3 / np.pi * solar_irradiance(computed.sigma)
        listed = Spectrum(computed.sigma, sun * transmission(published, computed.sigma), published.source)
        opd = np.linspace(0.6e-3, 5e-3, 2000)
        apart = np.abs(coherence(computed, band, opd) - coherence(listed, band, opd)).max()
        for name, spectrum in (("computed", computed), ("published", listed)):
            rise = coherent_rise(spectrum, band, 5e-3)
            rows.append({"filter": f"{centre:.1f}/{fwhm:.1f} nm {shape}", "lines": name, "rise_opd_m": rise.opd_m,
                         "nma": rise.nma, "coherence_apart": apart})  # fmt: skip
    return rows


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("list", type=Path, metavar="FILE.csv", help="the published line list")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    arguments = parser.parse_args()
    if not arguments.list.is_file():
        parser.error(f"{arguments.list}: no such file; the list is published with the MATS programs")
    published, dipole = read_list(arguments.list)
    found = {**compare_lines(published, dipole), "rises": compare_rises(published)}
    if arguments.json:
        print(to_json(found))
        return
    print(table(found["branches"]))
    print("band intensity, cm/molecule:", ", ".join(f"{k} {v:.4e}" for k, v in found["band_intensity_cm"].items()))
    widths = ", ".join(f"{j}: {r:.3f}" for j, r in found["half_width_ratio"].items())
    print(f"air half-width computed/published by J″: {widths}\n")
    print(table(found["rises"]))


if __name__ == "__main__":
    main()
