"""``import_lens``: a lens file of another program, made into an instrument file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path as File
from typing import Any

from cgi_wave.errors import InputError
from cgi_wave.lensfile import seq, zmx
from cgi_wave.lensfile.build import build
from cgi_wave.lensfile.listing import Listing, Remark
from cgi_wave.lensfile.toml import to_toml
from cgi_wave.optics.system import Instrument, from_document
from cgi_wave.rays.paths import Path

READERS = {".zmx": zmx.read, ".seq": seq.read}


@dataclass(frozen=True)
class Imported:
    """An imported lens: the file, plain data of an instrument file, its nominal path with the file's numbers of the
    surfaces on it (the image last), and every difference."""

    file: str
    document: dict[str, Any]
    path: Path
    numbers: tuple[int, ...]
    remarks: tuple[Remark, ...]

    @property
    def instrument(self) -> Instrument:
        """The instrument, with one band named ``design``."""
        return from_document(self.document, self.file)

    @property
    def toml(self) -> str:
        """The text of the instrument file."""
        return to_toml(self.document)

    def report(self) -> dict[str, Any]:
        """The differences and the nominal path as plain data."""
        return {"file": self.file, "path": str(self.path), "remarks": [asdict(remark) for remark in self.remarks]}

    def text(self) -> str:
        """The differences, a line each."""
        lines = [f"{self.file}: {len(self.document['frame'])} frames, nominal path {self.path}"]
        return "\n".join(lines + [f"  {remark}" for remark in self.remarks])


def import_lens(
    path: str | File,
    glasses: Mapping[str, str | float] | None = None,
    primary_only: bool = False,
    keep_stop: bool = False,
) -> Imported:
    """Read a Zemax (.zmx) or CODE V (.seq) sequential lens file.

    glasses: catalogue page "shelf/book/page" or constant index by the name of a glass in the file; they win over the
    file's own catalogue. primary_only: import the reference wavelength alone, as model glasses need. keep_stop: keep a
    stop in the air as a surface of its own although there are mirrors (the nominal path can be traced, but light that
    crosses the stop's plane again is not found by a search of paths).

    Raises InputError, with the line and keyword, for whatever would bend light in a way that an instrument file has no
    words for, and for glasses that name no single page.
    """
    file = File(path)
    if file.suffix.lower() not in READERS:
        remedy = f"name a file that ends in {' or '.join(READERS)}"
        raise InputError(str(path), "file", file.suffix, "is no lens file that can be read", remedy)
    try:
        listing = READERS[file.suffix.lower()](file)
    except OSError as error:
        raise InputError(
            str(path), "file", str(path), f"cannot be read ({error.strerror})", "name an existing file"
        ) from error
    if primary_only and len(listing.wavelengths) > 1:
        kept = listing.wavelengths[listing.primary]
        listing.remark("dropped", 0, "wavelengths", f"all but {kept:g} nm, as asked for")
        listing.wavelengths, listing.primary = [kept], 0
    document, nominal, numbers = build(listing, glasses or {}, keep_stop)
    document = document | {"notes": [f"imported from {file.name}", *_stand_ins(listing), *document["notes"]]}
    return Imported(str(path), document, nominal, tuple(numbers), tuple(listing.remarks))


def _stand_ins(listing: Listing) -> list[str]:
    """What an instrument file needs and a lens file does not say."""
    return [
        "coatings: glass faces are bare (Fresnel), mirrors reflect everything",
        "detector pixels, filter and spectrum are stand-ins",
    ]
