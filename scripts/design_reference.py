"""Design the reference instrument's optics and keep ``cgi_wave/data/reference.toml`` in step with it.

    uv run python scripts/design_reference.py            spots, margins and OPD of the stored instrument
    uv run python scripts/design_reference.py --check    optimise from the starting values, compare with the stored ones
    uv run python scripts/design_reference.py --write    optimise and write the result into the file
    uv run --group validation python scripts/design_reference.py --independent    trace it with batoid, too

The optimisation starts from the values in ``scripts/design/recipes.py``; of the stored file it takes what it does not
change (lenses 1 to 3, dichroic, cube, coatings, bands).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from design import pipeline
from design.independent import print_comparison
from design.model import Values, per_band
from design.recipes import RECIPES
from design.report import compare, print_report
from design.tomlfile import edit

from cgi_wave.optics.system import REFERENCE, Instrument, load_instrument


def design(template: Instrument) -> dict[str, Values]:
    """The designed values: "" for the instrument's, and one entry per band."""
    out: dict[str, Values] = {"": {}}
    for channel, bands in template.channels.items():
        named = pipeline.optimise(template, channel)
        own = per_band(RECIPES[channel])
        for band in bands:
            values = pipeline.set_interferometer(template, named, band)
            out[""] |= {name: value for name, value in values.items() if name not in own}
            out[band] = {name: values[name] for name in own}
    return out


def main(arguments: list[str] | None = None) -> int:
    """Run the command; 0, or 1 if ``--check`` finds a difference."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--write", action="store_true", help="write the designed values into the instrument file")
    group.add_argument("--check", action="store_true", help="compare the designed values with the stored ones")
    group.add_argument("--independent", action="store_true", help="compare our rays with those of batoid")
    parser.add_argument("--instrument", type=Path, default=REFERENCE, help="instrument file (default: the reference)")
    options = parser.parse_args(arguments)
    stored = load_instrument(options.instrument)
    if options.independent:
        print_comparison(stored)
        return 0
    if options.write or options.check:
        designed = design(stored)
        if options.check:
            return compare(stored, designed)
        # Masks move with the mirror that they surround; apertures are cut when the rays are known.
        moved = pipeline.aperture_values(pipeline.sizes_of(stored), designed[""])
        text = edit(options.instrument.read_text(encoding="utf-8"), designed | {"": {**designed[""], **moved}})
        options.instrument.write_text(text, encoding="utf-8")
        stored = load_instrument(options.instrument)
        sizes = pipeline.cut_apertures([stored.band(band) for band in stored.bands])
        text = edit(text, {"": pipeline.aperture_values(sizes, designed[""])})
        options.instrument.write_text(text, encoding="utf-8")
        stored = load_instrument(options.instrument)
    print_report(stored)
    return 0


if __name__ == "__main__":
    sys.exit(main())
