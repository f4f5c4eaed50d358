"""From an analysis to files and text: the folder of ``cgi-wave run`` and what the commands print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cgi_wave.budget.table1 import ROWS, format_table1
from cgi_wave.report import page, plots, tables
from cgi_wave.report.output import to_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cgi_wave.analysis import Analysis, BandResult
    from cgi_wave.fringes.nma import Parasitic

DPI = 130
PROCESSES = 2
TABLE_SUFFIXES = (".csv", ".nc", ".mat")


def write(
    analysis: Analysis, views: Sequence[Mapping[str, Any]], provenance: Mapping[str, Any], folder: Path
) -> dict[str, Any]:
    """Fill ``folder``: ``summary.json``, ``index.html``, and per band the ghost tables, the PSIs and the pictures.

    views : of ``report.layout``. Returns the summary: ``bands.<BAND>`` with Table 1's rows (each
    ``mean``, ``spread``, ``error``), ``ghost_count``, ``fields`` (how many) and the rest of Table 1; ``provenance``.
    """
    summary = {"bands": {name: _summary(band) for name, band in analysis.bands.items()}, "provenance": provenance}
    files = ["summary.json"]
    bands = []
    import matplotlib.backends.backend_agg
    import matplotlib.figure  # noqa: F401  (before the processes part, which then need not import it each)

    with ProcessPoolExecutor(PROCESSES) as pool:  # drawing a band takes seconds, and no band waits for another
        drawn = {}
        for name, band in analysis.bands.items():
            first = {part: getattr(band.fields[0], part) for part in ("psi", "spots", "psfs")}
            drawn[name] = pool.submit(_pictures, name, first, band.ghosts, provenance, folder)
        _save(layout_figure(views), folder / "layout.png", provenance)
        for name, band in analysis.bands.items():
            for suffix in TABLE_SUFFIXES:
                files.append(f"{name}-ghosts{suffix}")
                tables.write_ghosts(folder / files[-1], band.ghosts, provenance, suffix)
            for part in ("surfaces", "families"):
                files.append(f"{name}-{part}.csv")
                tables.write_ghosts(folder / files[-1], band.costs[part], provenance, ".csv")
            files.append(f"{name}-psi.json")
            interferograms = [psi_document(band, index) for index in range(len(band.fields))]
            _text(folder / files[-1], to_json({"band": name, "fields": interferograms, "provenance": provenance}))
            bands.append(
                {
                    "name": name,
                    "about": _about(band),
                    "table1": band.table1,
                    "ghosts": band.ghosts,
                    "costs": band.costs,
                    "pictures": drawn[name].result(),
                    "plan": str(band.plan),
                }
            )
    document = {
        "title": f"Ghosts of {analysis.instrument_name}",
        "lead": "Every ghost found by tracing, its overlap with the nominal beams from its own rays, and what all of "
        "them together do to the retrieved modulation amplitude NMA = M/B.",
        "provenance": {**provenance, "seconds": f"{analysis.seconds:.1f}"},
        "files": files,
        "pictures": [
            {"file": "layout.png", "caption": "Layout with the rays of three field points in both arms.", "wide": True}
        ],
        "bands": bands,
    }
    _text(folder / "index.html", page.render(document))
    _text(folder / "summary.json", to_json(summary))
    return summary


def layout_figure(views: Sequence[Mapping[str, Any]]) -> Figure:
    """The views of ``report.layout`` one above the other."""
    return plots.grid(plots.plot_layout, views, columns=1, cell=(11.0, 6.0))


def psi_document(band: BandResult, field: int = 0) -> dict[str, Any]:
    """The interferogram of one field point and what was retrieved from it.

    ``opd_m`` in m; ``nominal`` and ``with_stray_light`` (coherent) and ``paper_bookkeeping``, irradiance
    relative to the input; ``modulation``, ``baseline`` (same unit) and ``nma``, each {``nominal``,
    ``with_stray_light``, ``error``}, the last being the error bound of the nominal value.
    """
    chosen = band.fields[field]
    psi, retrieval = chosen.psi, chosen.retrieval
    return {
        "field": chosen.index,
        "x_m": chosen.x_m,
        "y_m": chosen.y_m,
        "opd_m": psi.opd_m,
        "nominal": psi.nominal.irradiance,
        "with_stray_light": psi.coherent.irradiance,
        "paper_bookkeeping": psi.paper.irradiance,
        "irradiance_error": {"nominal": psi.nominal.error, "with_stray_light": psi.coherent.error},
        **{
            name: {
                "nominal": getattr(retrieval.nominal, name).value,
                "with_stray_light": getattr(retrieval.coherent, name),
                "error": getattr(retrieval.nominal, name).error,
            }
            for name in ("modulation", "baseline", "nma")
        },
        "coherent": _parasitic(retrieval.coherent),
        "paper": _parasitic(retrieval.paper),
        "method": psi.method,
    }


def psi_text(document: Mapping[str, Any]) -> str:
    """M, B and NMA without and with stray light, for reading."""
    opd = [value * 1e3 for value in (document["opd_m"][0], document["opd_m"][-1])]
    lines = [f"field {document['field']}, OPD {opd[0]:.4f} … {opd[1]:.4f} mm, {len(document['opd_m'])} rows"]
    lines += [f"{'':<12}{'nominal':>12}{'with ghosts':>14}{'error':>10}"]
    for name in ("modulation", "baseline", "nma"):
        row = document[name]
        lines.append(f"{name:<12}{row['nominal']:>12.6f}{row['with_stray_light']:>14.6f}{row['error']:>10.1e}")
    error = document["coherent"]["nma_error"]
    lines.append(f"NMA error {error['value']:+.5f} (error {error['error']:.0e}); the whole interferogram with --json")
    return "\n".join(lines)


def ghosts_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """The ghost table for reading, the columns and units of the page, widest column last."""
    columns = sorted(page.GHOST_COLUMNS, key=lambda column: column.key == "label")
    cells = [[column.heading for column in columns], *([column.text(row) for column in columns] for row in rows)]
    widths = [max(len(line[index]) for line in cells) for index in range(len(columns))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column.kind == "text" else cell.rjust(width)
            for cell, width, column in zip(line, widths, columns, strict=True)
        ).rstrip()
        for line in cells
    )


def run_text(analysis: Analysis, folder: Path) -> str:
    """Table 1 and where the report is."""
    counts = ", ".join(f"{name} {band.ghost_count} ghosts" for name, band in analysis.bands.items())
    table = format_table1({name: band.table1 for name, band in analysis.bands.items()})
    return f"{table}\n{counts}; {analysis.seconds:.1f} s\n{folder / 'index.html'}"


def _summary(band: BandResult) -> dict[str, Any]:
    figures = {name: band.table1[name] for name in ROWS}
    return {**figures, "ghost_count": band.ghost_count, **{k: v for k, v in band.table1.items() if k not in figures}}


def _parasitic(part: Parasitic) -> dict[str, Any]:
    """The figures of one book-keeping with their errors."""
    names = (*ROWS, "nma_error_linear")
    return {name: {"value": getattr(part, name).value, "error": getattr(part, name).error} for name in names}


def _about(band: BandResult) -> str:
    opd = [1e3 * value for field in band.fields for value in (field.psi.opd_m[0], field.psi.opd_m[-1])]
    wavelength = 1e9 / band.fields[0].psi.sigma0
    return (
        f"Effective wavelength {wavelength:.2f} nm, OPD {min(opd):.4f} to {max(opd):.4f} mm, {len(band.fields)} field "
        f"points, {band.ghost_count} ghosts."
    )


def _pictures(
    name: str, first: Mapping[str, Any], ghosts: Sequence[Any], provenance: Mapping[str, Any], folder: Path
) -> list[dict[str, Any]]:
    """Draw the pictures of one band, and list them with their captions.

    first : ``psi``, ``spots`` and ``psfs`` of its first field point
    """
    from cgi_wave.fringes.plots import plot_psi

    drawn = [
        ("psi", "The interferogram and what ghosts add to it, at the first field point.",
         plots.figure(plot_psi, first["psi"], (8.0, 5.0))),
        ("contrast", "Overlap contrast of every ghost against Eq. 4; the bars are error bounds.",
         plots.figure(plots.plot_contrast, ghosts, (6.4, 4.8))),
        ("spots", "Irradiance of the nominal beam and of the strongest ghosts of one point source, all on one scale "
         "of length about the nominal image point; power is relative to the nominal beam of arm 1, rays are blurred.",
         plots.grid(plots.plot_irradiance, first["spots"])),
        ("psfs", "Point spread functions of the same beams, each on a window of its own and below its own peak; "
         "“geometric” marks rays in the place of a wavefront too steep for the picture’s transform.",
         plots.grid(plots.plot_psf, first["psfs"])),
    ]  # fmt: skip
    pictures = []
    for kind, caption, figure in drawn:
        file = f"{name}-{kind}.png"
        _save(figure, folder / file, provenance)
        pictures.append({"file": file, "caption": f"{name}: {caption}", "wide": kind in ("spots", "psfs")})
    return pictures


def _save(figure: Figure, path: Path, provenance: Mapping[str, Any]) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(DPI)
    # Not savefig, which draws the whole figure once more to lay it out.
    FigureCanvasAgg(figure).print_png(path, metadata={"Software": "cgi-wave", "Description": to_json(provenance)})


def _text(path: Path, text: str) -> None:
    path.write_text(text + "\n", encoding="utf-8")
