"""CODE V sequential files (.seq): statements parted by line ends or semicolons, "!" begins a comment, "&" continues.

Angles ADE and BDE are left-handed, CDE right-handed; a tilt turns about x, then the new y, then the new z.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from cgi_wave.lensfile.listing import UNITS, Field, Glass, Listing, Move, Opening, Row, number, refuse
from cgi_wave.lensfile.zmx import read_text

_UNITS = {"M": "mm", "MM": "mm", "C": "cm", "CM": "cm", "I": "in", "IN": "in"}
#: Statements without optical meaning: labels, couplings of the optimiser, weights, remarks, plots.
_SILENT = frozenset(
    (
        "LEN TIT INI CCY CUC THC GLC KC ADC BDC CDC XDC YDC ZDC AC BC CC DC EC CCF SLB WTF WTX WTY DER CLS POL GO LIS "
        "FIO OUT CUM THM CA TOL DLR DLT DLF DLN DLA DLB VIE DRA RSI REM"
    ).split()
)
_SOLVES = ("PIK", "RED", "HMY", "UMY", "IMY", "ITY")
_ASPHERES = ("A", "B", "C", "D", "E", "F", "G", "H", "J", "CUF")
_BENDS = frozenset(
    "XTO YTO CYL SPL SPS GRT DIF HOE DOE ZRN BIF LEA GRI AAS CUX AAP NSS LUM INT THG QBF QCN SCO".split()
)
_FIELDS = {"XAN": ("angle", 0), "YAN": ("angle", 1), "XIM": ("height", 0), "YIM": ("height", 1)}
_VIGNETTING = ("VUX", "VLX", "VUY", "VLY")


def statements(text: str) -> list[tuple[int, list[str]]]:
    """Line number and words of every statement; a word in quotes stays whole."""
    found: list[tuple[int, list[str]]] = []
    begun: list[str] = []
    for line, content in enumerate(text.splitlines(), 1):
        part: list[str] = begun
        begun = []
        for word in re.findall(r"'[^']*'|\"[^\"]*\"|![^\n]*|;|&|[^\s;!&]+", content):
            if word.startswith("!"):
                break
            if word == ";":
                if part:
                    found.append((line, part))
                part = []
            elif word == "&":
                begun = part
                part = []
            else:
                part = [*part, word.strip("'\"") if word[0] in "'\"" else word]
        if part:
            found.append((line, part))
    return found


class _Reader:
    """The state while statements are read one by one."""

    def __init__(self, path: Path) -> None:
        self.listing = Listing(str(path), name=path.stem)
        self.rows: list[Row] = []
        self.radius_mode = False
        self.unit = 1.0
        self.fields: dict[str, list[float]] = {}
        self.private = False
        self.tilts: dict[int, dict[str, float]] = {}
        self.kinds: dict[int, tuple[str, int]] = {}
        self.holes: dict[int, dict[str, float]] = {}
        self.waves_line = 0

    def number(self, line: int, key: str, text: str) -> float:
        return number(self.listing.file, line, key, text)

    def first(self, line: int, key: str, words: list[str]) -> float:
        """The number that a statement needs."""
        if not words:
            self.listing.refuse(line, key, "", "lacks its value", "write a number behind it")
        return self.number(line, key, words[0])

    def target(self, words: list[str]) -> tuple[int, list[str]]:
        """The surface that a statement is about (the current one if it names none), and what follows its name."""
        if words and re.fullmatch(r"[sS](\d+|O|I|o|i|\d*\.\.\d*)", words[0]):
            name = words[0][1:].upper()
            last = len(self.rows) - 1
            return (0 if name == "O" else last if name == "I" else int(name)), words[1:]
        return len(self.rows) - 1, words

    def take(self, line: int, words: list[str]) -> None:
        """One statement."""
        key = words[0].upper()
        rest = words[1:]
        if self.private:
            self.private = key != "END"
            return
        if re.fullmatch(r"S|SO|SI|S\d+", key):
            self.surface(line, key, rest)
            return
        short = key[:3]
        if key == "PRV":
            self.private = True
            self.listing.remark("dropped", line, key, "private glass catalogue: choose pages for its glasses")
        elif short == "RDM":
            self.radius_mode = not rest or rest[0].upper().startswith("Y")
        elif short == "TIT":
            self.listing.name = " ".join(rest) or self.listing.name
        elif short == "DIM":
            unit = rest[0].upper() if rest else ""
            if unit not in _UNITS:
                self.listing.refuse(line, key, unit, "is an unknown unit", "use M (millimetres), C or I")
            self.unit = UNITS[_UNITS[unit]]
        elif short in ("EPD", "FNO", "NA"):
            kind = {"EPD": "diameter", "FNO": "f-number", "NA": "na"}[short]
            self.listing.aperture = (kind, self.first(line, key, rest))
        elif key in ("NAO", "OBJ"):
            self.listing.refuse(line, key, " ".join(rest), "is an aperture of a near object", "give EPD, FNO or NA")
        elif short == "WL":
            self.listing.wavelengths = [self.number(line, key, word) for word in rest]
            self.waves_line = line
        elif short == "REF":
            self.listing.primary = int(self.first(line, key, rest)) - 1
        elif short == "WTW":
            if len(set(rest)) > 1:
                self.listing.remark("dropped", line, key, "weights of the wavelengths")
        elif key in _FIELDS or key in _VIGNETTING:
            self.fields[key] = [self.number(line, key, word) for word in rest]
        elif key in ("XOB", "YOB", "XRI", "YRI"):
            self.listing.refuse(line, key, " ".join(rest), "are fields of another kind", "give angles XAN, YAN")
        elif short == "PIM":
            self.listing.solve = (line, 0.0)
        elif short in _SOLVES or (short == "THI" and any(word.upper() in _SOLVES for word in rest)):
            self.listing.remark("substituted", line, key, "solve or pickup replaced by the value that the file gives")
        elif not self.of_surface(line, key, rest) and short not in _SILENT:
            if self.rows and key in _BENDS:
                problem = f"of surface {self.rows[-1].number} is not supported"
                self.listing.refuse(
                    line, key, " ".join(rest), problem, "only spheres, conics and planes have a counterpart"
                )
            if self.rows:
                self.listing.refuse(line, key, " ".join(rest), "is an unknown statement among the surfaces",
                                    "remove it if it has no optical meaning")  # fmt: skip
            self.listing.remark("ignored", line, key, "unknown statement before the surfaces")

    def surface(self, line: int, key: str, rest: list[str]) -> None:
        """``S radius thickness glass``, a new surface."""
        shape = self.number(line, key, rest[0]) if rest else 0.0
        curvature = (1.0 / shape if shape else 0.0) if self.radius_mode else shape
        thickness = self.number(line, key, rest[1]) if len(rest) > 1 else 0.0
        medium = self.medium(line, rest[2]) if len(rest) > 2 else None
        self.rows.append(Row(len(self.rows), line, curvature, 0.0, thickness, medium))

    def medium(self, line: int, text: str):  # type: ignore[no-untyped-def]
        """Air, a mirror, a glass by name and maker, or a model glass by its code."""
        name = text.strip("'\"")
        if name.upper() == "AIR":
            return None
        if name.upper() == "REFL":
            return "mirror"
        if name.upper() in ("REFR", "TIR"):
            self.listing.refuse(line, "glass", text, "is a mode that is not supported", "name a glass, or REFL")
        if re.fullmatch(r"\d{6}", name):
            return Glass(name, 1 + int(name[:3]) / 1000, int(name[3:]) / 10)
        code = re.fullmatch(r"(\d+)\.(\d+)", name)
        if code:
            index = 1 + int(code[1]) / 10 ** len(code[1])
            return Glass(name, index, round(100 * float("0." + code[2]), 6))
        glass, _, maker = name.rpartition("_")
        return Glass(glass, catalogues=(maker,)) if glass else Glass(name)

    def of_surface(self, line: int, key: str, words: list[str]) -> bool:
        """A statement about one surface; False if it is none that is known."""
        if not self.rows:
            return False
        which, rest = self.target(words)
        if not 0 <= which < len(self.rows):
            self.listing.refuse(line, key, words[0], "names a surface that is not there yet", "define it before")
        row, short = self.rows[which], key[:3]

        def put(**values: object) -> bool:
            self.rows[which] = row.with_(**values)
            return True

        def value() -> float:
            return self.first(line, key, rest)

        if short == "STO":
            return put(stop=True)
        if short == "RDY":
            return put(curvature=1.0 / value() if value() else 0.0)
        if short == "CUY":
            return put(curvature=value())
        if short == "THI":
            return put(thickness=value())
        if short == "GLA":
            if not rest:
                self.listing.refuse(line, key, "", "lacks its value", "name a glass behind it")
            return put(medium=self.medium(line, rest[0]))
        if short == "RMD":
            return put(medium="mirror" if rest and rest[0].upper() == "REFL" else row.medium)
        if short in ("SPH", "CON", "ASP"):
            return True
        if key == "K":
            return put(conic=value())
        if key in _ASPHERES:
            if value() != 0.0:
                self.listing.refuse(line, key, rest[0], f"makes surface {which} an asphere",
                                    "an instrument file has planes, spheres and conics only")  # fmt: skip
            return True
        if key in ("XDE", "YDE", "ZDE", "ADE", "BDE", "CDE"):
            self.tilts.setdefault(which, {})[key] = value()
            return True
        if short in ("DAR", "BEN", "REV", "RET", "GLB"):
            origin = int(rest[0][1:]) if rest and rest[0][:1].upper() == "S" and rest[0][1:].isdigit() else 1
            if short == "BEN" and which and row.medium != "mirror":
                self.listing.refuse(line, key, which, "bends the axis at a surface that does not reflect", "use DAR")
            self.kinds[which] = (short, origin)
            return True
        if short in ("XOD", "YOD", "ZOD"):
            if value() != 0.0:
                self.listing.refuse(line, key, rest[0], "moves the point of rotation", "give the decentres instead")
            return True
        if short in ("CIR", "REX", "REY", "ELX", "ELY", "ADX", "ADY", "ARO"):
            self.hole(line, key, which, rest)
            return True
        return False

    def hole(self, line: int, key: str, which: int, rest: list[str]) -> None:
        """A statement about a clear aperture."""
        if not rest:
            self.listing.refuse(line, key, "", "lacks its value", "write a number behind it")
        kinds = [word.upper() for word in rest[:-1]]
        if "OBS" in kinds or "HOL" in kinds:
            self.listing.refuse(line, key, " ".join(rest), f"blocks part of surface {which}",
                                "an aperture is a circle or a rectangle; remove it")  # fmt: skip
        if "EDG" in kinds:
            if key[:3] == "CIR" and "CIR" not in self.holes.get(which, {}):
                self.holes.setdefault(which, {})["EDG"] = self.number(line, key, rest[-1])
            return
        if key[:3] == "ARO" and self.number(line, key, rest[-1]) != 0.0:
            self.listing.refuse(line, key, rest[-1], "turns the aperture", "give an aperture along x and y")
        self.holes.setdefault(which, {})[key[:3]] = self.number(line, key, rest[-1])

    def finished(self) -> Listing:
        """The listing, in millimetres."""
        listing, s = self.listing, self.unit
        if len(self.rows) < 3:
            refuse(listing.file, 0, "S", len(self.rows), "are too few surfaces", "give a CODE V .seq file")
        rows = []
        for k, row in enumerate(self.rows):
            row = _moved(row, self.tilts.get(k, {}), self.kinds.get(k), s)
            opening = _opening(listing, row, self.holes.get(k, {}), s)
            rows.append(row.with_(curvature=row.curvature / s, thickness=row.thickness * s, opening=opening))
        image = rows[-1]
        if listing.solve:
            listing.solve = (listing.solve[0], image.thickness)
        if image.thickness:
            # CODE V keeps its defocus as the image's thickness, along the axis before the image's own tilt.
            rows[-2] = rows[-2].with_(thickness=rows[-2].thickness + image.thickness)
            text = f"defocus of {image.thickness:g} mm added to the distance before the image"
            listing.remark("substituted", image.line, "SI", text)
            rows[-1] = image.with_(thickness=0.0)
        listing.rows = rows
        if not listing.wavelengths:
            listing.refuse(0, "WL", "(none)", "there is no wavelength", "give WL")
        if not 0 <= listing.primary < len(listing.wavelengths):
            listing.refuse(0, "REF", listing.primary + 1, "is no wavelength", "give the number of one")
        if listing.aperture and listing.aperture[0] == "diameter":
            listing.aperture = ("diameter", listing.aperture[1] * s)
        listing.heights = any(_FIELDS[key][0] == "height" for key in self.fields if key in _FIELDS)
        self.read_fields(s)
        return listing

    def read_fields(self, scale: float) -> None:
        """Field points, angles or image heights, with the vignetting of each."""
        given = {key: values for key, values in self.fields.items() if key in _FIELDS}
        count = max((len(values) for values in given.values()), default=1)

        def column(key: str, unit: float = 1.0) -> list[float]:
            values = [value * unit for value in self.fields.get(key, [])]
            return (values + [0.0] * count)[:count]

        unit = scale if self.listing.heights else 1.0
        names = ("XIM", "YIM") if self.listing.heights else ("XAN", "YAN")
        for x, y, ux, lx, uy, ly in zip(
            column(names[0], unit), column(names[1], unit), *(column(key) for key in _VIGNETTING), strict=True
        ):
            self.listing.fields.append(Field((x, y), (lx - 1, 1 - ux), (ly - 1, 1 - uy)))
        if any(any(self.fields.get(key, [])) for key in _VIGNETTING):
            text = "vignetting factors: used for apertures that have to be traced, not for rays"
            self.listing.remark("dropped", 0, "VUX…VLY", text)


def _moved(row: Row, tilt: dict[str, float], kind: tuple[str, int] | None, scale: float) -> Row:
    """The row with its changes of axes."""
    shift = (tilt.get("XDE", 0.0) * scale, tilt.get("YDE", 0.0) * scale, tilt.get("ZDE", 0.0) * scale)
    move = Move(shift, (-tilt.get("ADE", 0.0), -tilt.get("BDE", 0.0), tilt.get("CDE", 0.0)))
    name, origin = kind or ("", 1)
    if name == "DAR":
        return row.with_(own=move)
    if name == "REV":
        return row.with_(after=move.inverse())
    if name == "BEN":
        return row.with_(before=move, after=replace(move, shift=(0.0, 0.0, 0.0)))
    if name in ("GLB", "RET"):
        return row.with_(before=move, origin=origin)
    return row.with_(before=move) if tilt else row


def _opening(listing: Listing, row: Row, hole: dict[str, float], scale: float) -> Opening | None:
    centre = (hole.get("ADX", 0.0) * scale, hole.get("ADY", 0.0) * scale)
    if "CIR" in hole:
        return Opening(radius=hole["CIR"] * scale, centre=centre)
    for x, y, what in (("REX", "REY", "rectangle"), ("ELX", "ELY", "ellipse")):
        if x in hole or y in hole:
            if x not in hole or y not in hole:
                listing.refuse(row.line, x, hole, f"is half a {what}", f"give {x} and {y}")
            if what == "rectangle":
                return Opening(half=(hole[x] * scale, hole[y] * scale), centre=centre)
            if hole[x] != hole[y]:
                listing.refuse(row.line, x, f"{hole[x]} {hole[y]}", "is an ellipse", "give a circle or a rectangle")
            return Opening(radius=hole[x] * scale, centre=centre)
    return Opening(radius=hole["EDG"] * scale, centre=centre, exact=False) if "EDG" in hole else None


def read(path: Path, text: str | None = None) -> Listing:
    """Read a CODE V file. Raises InputError where something would bend light in a way that is not supported."""
    reader = _Reader(path)
    for line, words in statements(read_text(path) if text is None else text):
        reader.take(line, words)
    return reader.finished()
