"""Zemax sequential files (.zmx): text of keyword lines, surfaces in blocks that begin with SURF.

Angles of coordinate breaks are right-handed, as in our own frames. Peers disagree on that; a published file whose image
is decentred to where its chief ray lands decides it (validation/listings.py).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from cgi_wave.lensfile.listing import UNITS, Field, Glass, Listing, Move, Opening, Row, number, refuse

#: Keywords of a surface without any optical meaning here.
_SILENT = frozenset(
    (
        "FIMP HIDE MIRR SLAB POPS MEMA COMM DRAW RSCE RWRE TOLE MAZH VCON VPAR VDSZ VCUR OEMA HDEL ZTYP GCOL SAGG EXTN "
        "COMH"
    ).split()
)
#: Keywords outside surfaces without any optical meaning here.
_HEAD = frozenset(
    (
        "VERS MODE NOTE PFIL LANG ENVD GFAC RAIM PUSH SDMA OMMA ROPD HYPR PICB POLS GLRS GSTD NSCD COFN BLNK MNUM MOFF "
        "TOL PWAV NAME UNIT FTYP XFLN YFLN FWGN VANN ZVAN GCAT WAVM DMFS REAX REAY TRAC TRAD MERI RDIA COHE SCPA"
    ).split()
)
_APERTURES = {"ENPD": "diameter", "FNUM": "f-number", "FLOA": "stop"}
#: Kinds of surface that are their conic if all parameters beyond are 0.
_CONICS = ("STANDARD", "EVENASPH", "EVENASPHERE", "ODDASPHE", "XASPHERE")


def read_text(path: Path) -> str:
    """Text of a file in UTF-16 or UTF-8, with or without a byte order mark, or Latin-1."""
    raw = path.read_bytes()
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16")
    if raw[1:2] == b"\0":
        return raw.decode("utf-16-le")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


@dataclass
class _Block:
    """One SURF block, as far as it is read: lines by keyword."""

    number: int
    line: int
    words: dict[str, tuple[int, list[str]]] = field(default_factory=dict)
    parameters: dict[int, tuple[int, float]] = field(default_factory=dict)

    def first(self, keyword: str, default: str = "0") -> tuple[int, str]:
        """Line and first word of a keyword."""
        line, words = self.words.get(keyword, (self.line, []))
        return line, words[0] if words else default


def read(path: Path, text: str | None = None) -> Listing:
    """Read a Zemax file. Raises InputError where something would bend light in a way that is not supported."""
    listing = Listing(str(path), name=path.stem)
    head: dict[str, tuple[int, list[str]]] = {}
    waves: list[tuple[int, float, float]] = []
    blocks: list[_Block] = []
    unknown: dict[str, int] = {}
    inside = False  # the lines of a surface are indented
    for line, content in enumerate((read_text(path) if text is None else text).splitlines(), 1):
        words = content.split()
        if not words:
            continue
        key, rest = words[0].upper(), words[1:]
        if key == "SURF":
            blocks.append(_Block(len(blocks), line))
            inside = True
        elif inside and content[:1] in " \t":
            _surface_line(listing, blocks[-1], line, key, rest)
        else:
            inside = False
            if key == "WAVM" and len(rest) >= 3:
                waves.append((int(number(listing.file, line, key, rest[0])), number(listing.file, line, key, rest[1]),
                              number(listing.file, line, key, rest[2])))  # fmt: skip
            elif key in _HEAD or key in _APERTURES or key[:2] in ("VD", "VC") or key == "OBNA":
                head.setdefault(key, (line, rest))
            else:
                unknown.setdefault(key, line)
    if not blocks:
        refuse(listing.file, 0, "SURF", "(none)", "is no Zemax file: it has no surface", "give a sequential .zmx file")
    for key, line in sorted(unknown.items(), key=lambda item: item[1]):
        listing.remark("ignored", line, key, "unknown keyword outside the surfaces")
    _read_head(listing, head, waves)
    catalogues = tuple(head.get("GCAT", (0, []))[1])
    scale = _scale(listing, head)
    listing.rows = [_row(listing, block, scale, catalogues, len(blocks)) for block in blocks]
    return listing


def _surface_line(listing: Listing, block: _Block, line: int, key: str, rest: list[str]) -> None:
    """Keep a line of a SURF block, or refuse it."""
    if key == "PARM" and len(rest) >= 2:
        block.parameters[int(number(listing.file, line, key, rest[0]))] = (
            line,
            number(listing.file, line, key, rest[1]),
        )
    elif key in ("CURV", "DISZ", "GLAS", "CONI", "DIAM", "STOP", "TYPE", "COAT", "CLAP", "FLAP", "SQAP", "ELAP", "OBDC",
                 "OBSC", "SQOB", "ELOB", "UDAP", "UAPP"):  # fmt: skip
        block.words[key] = (line, rest)
    elif key in ("PZUP", "PPAR", "PKUP", "CPUP", "GPUP", "PCON", "SDPU"):
        listing.remark("substituted", line, key, f"surface {block.number}: pickup replaced by the value stored with it")
    elif key in ("XDAT", "XTRA", "SCBD", "GRAT", "BIRF", "XPAR"):
        # Behind its value an extra datum has solves and scales, which are not zero.
        values = rest[1:] if key in ("SCBD", "BIRF") else rest[1:2]
        if any(_nonzero(word) for word in values):
            block.words.setdefault(key, (line, rest))
    elif key not in _SILENT:
        remedy = "remove the line if it has no optical meaning, or make the surface a standard one"
        listing.refuse(line, key, " ".join(rest), f"is an unknown keyword of surface {block.number}", remedy)


def _nonzero(word: str) -> bool:
    """Whether a word is a number other than 0."""
    try:
        return float(word) != 0.0
    except ValueError:
        return False


def _scale(listing: Listing, head: dict[str, tuple[int, list[str]]]) -> float:
    """Millimetres per unit of length."""
    line, words = head.get("UNIT", (0, ["MM"]))
    unit = {"INCH": "in", "IN": "in", "METER": "m"}.get(words[0].upper(), words[0].lower())
    if unit not in UNITS:
        listing.refuse(line, "UNIT", words[0], "is an unknown unit", "use MM, CM, IN or METER")
    return UNITS[unit]


def _read_head(listing: Listing, head: dict[str, tuple[int, list[str]]], waves: list[tuple[int, float, float]]) -> None:
    scale = _scale(listing, head)
    mode = head.get("MODE", (0, ["SEQ"]))
    if mode[1][:1] != ["SEQ"]:
        listing.refuse(mode[0], "MODE", " ".join(mode[1]), "is not sequential", "export the sequential model")
    listing.name = " ".join(head.get("NAME", (0, []))[1]) or listing.name
    if "OBNA" in head:
        listing.refuse(head["OBNA"][0], "OBNA", " ".join(head["OBNA"][1]), "is an aperture of a near object",
                       "give the entrance pupil's diameter (ENPD), object at infinity")  # fmt: skip
    for key, kind in _APERTURES.items():
        if key in head:
            line, words = head[key]
            value = number(listing.file, line, key, words[0]) if words else 0.0
            if kind == "f-number" and words[1:2] not in ([], ["0"]):
                listing.remark("substituted", line, key, "working F-number taken as that of an infinite object")
            listing.aperture = (kind, value * (scale if kind == "diameter" else 1.0))
    kind_line, kind_words = head.get("FTYP", (0, ["0"]))
    field_kind = int(kind_words[0])
    if field_kind not in (0, 2):
        names = {1: "object height", 3: "real image height"}
        listing.refuse(kind_line, "FTYP", names.get(field_kind, field_kind), "is a field of another kind",
                       "give fields as angles (FTYP 0) or paraxial image heights (FTYP 2)")  # fmt: skip
    listing.heights = field_kind == 2
    count = int(kind_words[2]) if len(kind_words) > 2 and int(kind_words[2]) > 0 else 1
    unit = scale if listing.heights else 1.0

    def values(key: str) -> list[float]:
        line, words = head.get(key, (0, []))
        found = [number(listing.file, line, key, word) for word in words[:count]]
        return found + [0.0] * (count - len(found))

    columns = [values(key) for key in ("XFLN", "YFLN", "VDXN", "VDYN", "VCXN", "VCYN")]
    for x, y, dx, dy, cx, cy in zip(*columns, strict=True):
        listing.fields.append(Field((x * unit, y * unit), (dx - 1 + cx, dx + 1 - cx), (dy - 1 + cy, dy + 1 - cy)))
    if any(any(column) for column in columns[2:]):
        listing.remark("dropped", head["VCYN"][0] if "VCYN" in head else 0, "VDXN…VCYN",
                       "vignetting factors: used for apertures that have to be traced, not for rays")  # fmt: skip
    _read_wavelengths(listing, head, waves)


def _read_wavelengths(
    listing: Listing, head: dict[str, tuple[int, list[str]]], waves: list[tuple[int, float, float]]
) -> None:
    line, words = head.get("PWAV", (0, ["1"]))
    main = int(float(words[0])) if words else 1
    # The list is filled up with a default; the number in use is not in old files.
    _, kind_words = head.get("FTYP", (0, []))
    count = int(kind_words[3]) if len(kind_words) > 3 and int(kind_words[3]) > 0 else 0
    used = waves[: max(count, main)] if count else waves[:main]
    if not used:
        listing.refuse(line, "WAVM", "(none)", "there is no wavelength", "give wavelengths as WAVM lines")
    listing.wavelengths = [1e3 * um for _, um, _ in used]
    listing.primary = main - 1
    if len({weight for _, _, weight in used}) > 1:
        listing.remark("dropped", line, "WAVM", "weights of the wavelengths")


def _row(listing: Listing, block: _Block, scale: float, catalogues: tuple[str, ...], count: int) -> Row:
    kind_line, kind = block.first("TYPE", "STANDARD")
    for key in ("XDAT", "XTRA", "SCBD", "GRAT", "BIRF", "XPAR"):
        if key in block.words:
            line, words = block.words[key]
            listing.refuse(line, key, " ".join(words), f"of surface {block.number} is not supported",
                           "use coordinate breaks for tilts; other surfaces have no counterpart")  # fmt: skip
    line, text = block.first("DISZ")
    distance = float("inf") if text.upper() == "INFINITY" else number(listing.file, line, "DISZ", text) * scale
    if block.number == count - 1:
        distance = 0.0
    elif block.number and distance == float("inf"):
        listing.refuse(line, "DISZ", text, f"behind surface {block.number} is infinite", "give a distance")
    if kind == "COORDBRK":
        return _coordinate_break(listing, block, scale, distance)
    if kind not in _CONICS:
        listing.refuse(kind_line, "TYPE", kind, f"of surface {block.number} is no conic",
                       "only STANDARD surfaces and coordinate breaks have a counterpart")  # fmt: skip
    for order, (line, value) in sorted(block.parameters.items()):
        if value != 0.0 and kind != "STANDARD":
            listing.refuse(line, f"PARM {order}", value, f"makes surface {block.number} an asphere ({kind})",
                           "an instrument file has planes, spheres and conics only")  # fmt: skip
    if "COAT" in block.words:
        line, words = block.words["COAT"]
        listing.remark("dropped", line, "COAT", f"surface {block.number}: coating {' '.join(words)}")
    line, text = block.first("CURV")
    return Row(
        block.number, block.line, number(listing.file, line, "CURV", text) / scale,
        number(listing.file, *_conic(block)), distance, _medium(listing, block, catalogues),
        "STOP" in block.words, _opening(listing, block, scale),
    )  # fmt: skip


def _conic(block: _Block) -> tuple[int, str, str]:
    line, text = block.first("CONI")
    return line, "CONI", text


def _medium(listing: Listing, block: _Block, catalogues: tuple[str, ...]):  # type: ignore[no-untyped-def]
    if "GLAS" not in block.words:
        return None
    line, words = block.words["GLAS"]
    name = words[0]
    if name.upper() == "MIRROR":
        return "mirror"
    if name.startswith("___"):
        if len(words) < 5:
            listing.refuse(line, "GLAS", " ".join(words), "is no glass", "give a glass by its name")
        index, abbe = (number(listing.file, line, "GLAS", word) for word in words[3:5])
        return Glass(f"model{index:g}:{abbe:g}", index, abbe)
    return Glass(name, catalogues=catalogues)


def _coordinate_break(listing: Listing, block: _Block, scale: float, distance: float) -> Row:
    value = {order: parameter for order, (_, parameter) in block.parameters.items()}
    shift = (value.get(1, 0.0) * scale, value.get(2, 0.0) * scale, 0.0)
    move = Move(shift, (value.get(3, 0.0), value.get(4, 0.0), value.get(5, 0.0)), value.get(6, 0.0) != 0.0)
    if block.first("GLAS", "")[1]:
        listing.refuse(block.line, "GLAS", block.first("GLAS")[1], "stands on a coordinate break", "remove it")
    return Row(block.number, block.line, thickness=distance, before=move, breaks=True)


def _opening(listing: Listing, block: _Block, scale: float) -> Opening | None:
    """The clear aperture of a surface: its own, or its semi-diameter."""
    for key in ("OBSC", "SQOB", "ELOB", "UDAP", "UAPP"):
        if key in block.words:
            line, words = block.words[key]
            listing.refuse(line, key, " ".join(words), f"blocks part of surface {block.number}",
                           "an aperture is a circle or a rectangle; remove it")  # fmt: skip

    def values(key: str) -> tuple[int, list[float]]:
        line, words = block.words[key]
        return line, [number(listing.file, line, key, word) * scale for word in words[:2]]

    centre = (0.0, 0.0)
    if "OBDC" in block.words:
        _, offset = values("OBDC")
        centre = (offset[0], offset[1])
    for key in ("CLAP", "FLAP"):
        if key in block.words:
            line, (inner, outer) = values(key)
            if inner > 0:
                listing.refuse(line, key, inner, f"blocks the middle of surface {block.number}",
                               "an aperture is a circle or a rectangle; set the inner radius to 0")  # fmt: skip
            return Opening(radius=outer, centre=centre)
    if "SQAP" in block.words:
        _, (x, y) = values("SQAP")
        return Opening(half=(x, y), centre=centre)
    if "ELAP" in block.words:
        line, (x, y) = values("ELAP")
        if x != y:
            listing.refuse(line, "ELAP", f"{x} {y}", "is an ellipse", "give a circle or a rectangle")
        return Opening(radius=x, centre=centre)
    line, text = block.first("DIAM")
    radius = number(listing.file, line, "DIAM", text) * scale
    return Opening(radius=radius, exact=False) if radius > 0 else None
