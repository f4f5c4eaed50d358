"""The page that a person opens: ``index.html`` beside the pictures, with nothing fetched from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Column:
    """One column of the ghost table: key of the row, heading with the unit shown, factor from SI, format."""

    key: str
    heading: str
    scale: float = 1
    form: str = ".3g"

    def text(self, row: Mapping[str, Any]) -> str:
        """The cell as shown; a dash where the quantity was not computed."""
        value = row[self.key]
        if value is None:
            return "–"
        return value if isinstance(value, str) else format(value * self.scale, self.form)

    def key_for_sorting(self, row: Mapping[str, Any]) -> str:
        """What the page sorts by: the full number, or the text."""
        value = row[self.key]
        return "" if value is None else str(value)

    @property
    def kind(self) -> str:
        """CSS class and way of sorting."""
        return "text" if self.form == "s" else "number"


GHOST_COLUMNS = (
    Column("label", "ghost", form="s"),
    Column("order", "order", form="d"),
    Column("transmission", "power / % of nominal", 1e2),
    Column("rms_x_m", "RMS x / µm", 1e6),
    Column("rms_y_m", "RMS y / µm", 1e6),
    Column("contrast_eq4", "contrast, Eq. 4"),
    Column("contrast", "contrast |γ|"),
    Column("contrast_error", "error bound of |γ|", form=".1e"),
    Column("contrast_uniform", "contrast |J|, uniform scene"),
    Column("contrast_uniform_error", "error bound of |J|", form=".1e"),
    Column("opd_m", "OPD / mm", 1e3, ".6g"),
    Column("fringes", "fringes in zone"),
    Column("method", "method of |γ|", form="s"),
)


SURFACE_COLUMNS = (
    Column("name", "surface", form="s"),
    Column("coating", "coating", form="s"),
    Column("ghosts", "ghosts", form="d"),
    Column("power", "power / % of nominal", 1e2),
    Column("power_share", "its share / %", 1e2),
    Column("contrast_nominal", "|J| with nominal"),
    Column("contrast_family", "|J| in its family"),
    Column("contrast", "|γ| with nominal"),
    Column("share_offset", "O/B, share / %", 1e2),
    Column("share_modulation", "M*/M, share / %", 1e2),
    Column("share_nma", "NMA error, share / %", 1e2),
    Column("removed_nma", "falls by, if removed / %", 1e2),
    Column("removed_nma_error", "± / %", 1e2, ".1e"),
    Column("alone_nma", "is, alone / %", 1e2),
    Column("alone_nma_error", "± / %", 1e2, ".1e"),
)
"""Columns of what surfaces cost; those of families are the same without the coating."""


TABLE1_ROWS = {
    "offset_over_baseline": "baseline offset O/B",
    "parasitic_over_modulation": "parasitic modulation M*/M",
    "nma_error": "NMA error, exact: 1 − (1 + M*/M)/(1 + O/B)",
    "nma_error_linear": "NMA error by Eq. 1: O/B − M*/M",
}
"""Rows of Table 1 on the page, by their keys in the result of ``budget.table1``."""


def mean_spread(value: Mapping[str, float | None] | None) -> str:
    """``mean ± spread (error e)``, leaving out what is None; a dash for no value at all."""
    if value is None:
        return "–"
    mean, spread, error = value["mean"], value["spread"], value.get("error")
    size = max(abs(part) for part in (mean, spread) if part is not None)
    form = ".2e" if 0.0 < size < 1e-3 else ".5f"
    text = format(mean, form) if spread is None else f"{mean:{form}} ± {spread:{form}}"
    return text if error is None else f"{text} (error {error:.0e})"


def render(document: Mapping[str, Any]) -> str:
    """The whole page as one string of HTML.

    document
        ``title``; ``lead``, one sentence; ``provenance``, a (nested) dict; ``files``, names of the tables beside the
        page; ``pictures``, a list of {``file``, ``caption``} for the instrument as a whole; ``bands``, a list of dicts:

        * ``name``, ``about`` (one sentence)
        * ``table1``: the result of ``budget.table1``: ``TABLE1_ROWS`` there and in its ``paper_bookkeeping`` and
          ``printed`` (or None), each {``mean``, ``spread``, ``error``}; ``fields``, how many; ``why``, text or None;
          ``why_rows``, a sentence per printed row, or None
        * ``ghosts``: rows with the keys of ``GHOST_COLUMNS``, and ``path``, which unfolds under the label
        * ``costs``: of ``budget.cost_table.cost_table``
        * ``pictures``: list of {``file``, ``caption``}
        * ``plan``: text shown as it stands, or ""
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("cgi_wave.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["mean_spread"] = mean_spread
    return environment.get_template("index.html").render(
        columns=GHOST_COLUMNS,
        cost_columns=_cost_columns(),
        table1_rows=TABLE1_ROWS,
        facts=list(_flat(document["provenance"])),
        **document,
    )


def _cost_columns() -> dict[str, tuple[Column, ...]]:
    families = tuple(column for column in SURFACE_COLUMNS if column.key != "coating")
    return {"surfaces": SURFACE_COLUMNS, "families": families}


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Sequence[tuple[str, str]]:
    """Leaves of a nested dict as (dotted name, text)."""
    leaves: list[tuple[str, str]] = []
    for key, value in tree.items():
        name = f"{prefix}{key}"
        leaves += _flat(value, f"{name}.") if isinstance(value, Mapping) else [(name, str(value))]
    return leaves
