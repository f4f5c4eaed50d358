"""One band at one field point, by hand: the instrument, its ghosts, their contrasts, the interferogram, two pictures.

Run as ``uv run python scripts/band_analysis.py NIR --floor 2e-3 --out pictures``. What ``cgi-wave run`` does for all
field points, a step at a time, to be changed at will.
"""

import argparse
from pathlib import Path

import matplotlib

import cgi_wave as cw


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Analyse the band, print what was found, save the pictures; the three rows of Table 1 at this field point."""
    parser = argparse.ArgumentParser(description="One band at one field point.")
    parser.add_argument("band")
    parser.add_argument("--field", type=int, default=0, help="number of the field point")
    parser.add_argument("--floor", type=float, default=1e-4, help="least power of a ghost, relative to the nominal")
    parser.add_argument("--tolerance", type=float, default=1e-4)
    parser.add_argument("--out", type=Path, default=Path("."))
    options = parser.parse_args(arguments)

    # The band of the instrument: optics, field point, spectrum behind the filter.
    system = cw.load_instrument().band(options.band)
    x0 = system.field_points()[options.field]
    band = cw.band_setting(system)

    # Ghost paths, nominal beams first; those with power enough.
    paths = [path for path in cw.find_paths(system) if path.order == 0 or path.estimate > options.floor]

    # A uniform scene: powers and mutual coherence of all beams at this detector point.
    point = cw.field_point(band, paths, x0, options.tolerance)

    # A point source: where the rays land, Eq. 4, and the overlap contrast with the nominal beam of arm 1.
    source = cw.point_source(system, paths, point.theta, x0)
    for ghost in source.ghosts:
        if ghost.contrast is not None:
            print(f"{ghost.path.label:<40} |γ| = {ghost.contrast:.5f} ± {ghost.error:.0e}, Eq. 4: {ghost.eq4:.5f}")

    # The interferogram along the band's zone, and what is retrieved from it.
    rows = cw.zone_rows(system, x0)
    psi = cw.synthesise(point.coherency, band.spectrum.sigma, band.weight, rows, system.pixel)
    found = cw.retrieve(psi).coherent
    names = ("offset_over_baseline", "parasitic_over_modulation", "nma_error")
    for name in names:
        print(f"{name:<40} {getattr(found, name).value:+.5f} ± {getattr(found, name).error:.0e}")

    matplotlib.use("Agg")
    cw.plot_psi(psi).figure.savefig(options.out / f"{options.band}-psi.png")
    ghosts = cw.ghost_rows(system, [(point, source)])
    cw.plot_contrast(ghosts).figure.savefig(options.out / f"{options.band}-contrast.png")
    return {name: getattr(found, name).value for name in names}


if __name__ == "__main__":
    main()
