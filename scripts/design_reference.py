"""Design the reference instrument's optics and keep ``cgi_wave/data/reference.toml`` in step with it.

    uv run python scripts/design_reference.py            spots, margins and OPD of the stored instrument
    uv run python scripts/design_reference.py --check    optimise from the starting values, compare with the stored ones
    uv run python scripts/design_reference.py --write    optimise and write the result into the file
    uv run --group validation python scripts/design_reference.py --independent    trace it with batoid, too

The optimisation starts from the values in ``scripts/design/model.py``; of the stored file it takes what it does not
change (lenses 1 to 3, dichroic, cube, coatings, bands).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from design import pipeline
from design.independent import print_comparison
from design.model import Values
from design.report import compare, print_report
from design.tomlfile import edit

from cgi_wave.optics.system import REFERENCE, Instrument, load_instrument


def design(template: Instrument) -> dict[str, Values]:
    """The designed values: "" for the instrument's, and one entry per band."""
    named = pipeline.optimise(template)
    bands = {band: pipeline.set_interferometer(template, named, band) for band in template.bands}
    first = next(iter(bands.values()))
    shared: Values = {name: value for name, value in first.items() if name not in pipeline.PER_BAND}
    return {"": shared, **{band: {name: values[name] for name in pipeline.PER_BAND} for band, values in bands.items()}}


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
        text = edit(options.instrument.read_text(encoding="utf-8"), designed)
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
