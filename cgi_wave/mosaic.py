"""One frame of a whole detector: the zones of its bands side by side, over one scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cgi_wave import DEFAULT_TOLERANCE
from cgi_wave.budget.fringefield import zone_of, zone_rows_lit
from cgi_wave.errors import InputError
from cgi_wave.frames import Frame, check_shift, field_of, framed
from cgi_wave.fringes.field import FringeField
from cgi_wave.optics.system import Instrument, load_instrument
from cgi_wave.ready import Progress, Stopwatch, ZoneEdges, place_scene

Array = NDArray[np.float64]
Real = NDArray[np.floating]


@dataclass(frozen=True)
class DetectorFrame:
    """One frame of a detector. x_m (X,), y_m (R,) : all its pixels, m; parts : the bands' frames, by rows

    band (R,) : whose light each row sees, "" for rows that no band's glass fills
    frame, nominal (R, X) : irradiance relative to the input of the row's band, with and without ghosts; opd_m (R, X).
    All three are 0 on pixels of no band
    error : the largest of the bands' bounds. Not in it, nor in the frame: light of one band on another one's rows
    """

    detector: str
    x_m: Array
    y_m: Array
    band: NDArray[np.str_]
    frame: Real
    nominal: Real
    opd_m: Array
    error: float
    parts: tuple[Frame, ...]
    scene: str
    shift: float
    instrument_name: str
    instrument_hash: str

    @property
    def empty_rows(self) -> tuple[tuple[int, int], ...]:
        """First and last + 1 row of every run that no band fills."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], (self.band == "").astype(int), [0]])))
        return tuple((int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True))


def bands_of(instrument: Instrument, name: str) -> tuple[str, ...]:
    """Bands that a word means: a band, bands with commas between, a channel or a detector (all its bands).

    Raises InputError for what is none of these, and for bands that lie on different detectors.
    """
    if name in instrument.bands:
        return (name,)
    on = {band: instrument.band(band).document.detector.surface for band in instrument.bands}
    of = {band: instrument.band(band).spec.channel for band in instrument.bands}
    for groups in (on, of):
        found = tuple(band for band, group in groups.items() if group == name)
        if found:
            return found
    chosen = tuple(dict.fromkeys(part.strip() for part in name.split(",")))
    known = [*instrument.bands, *dict.fromkeys(filter(None, of.values())), *dict.fromkeys(on.values())]
    for band in chosen:
        if band not in on:
            remedy = f"use {' or '.join(known)}, or bands with commas between"
            raise InputError("command line", "BAND", band, "the instrument has no such band or detector", remedy)
    surfaces = {on[band] for band in chosen}
    if len(surfaces) > 1:
        raise InputError("command line", "BAND", name, f"lies on several detectors, {' and '.join(sorted(surfaces))}",
                         "name bands of one of them")  # fmt: skip
    return chosen


def detector_frame(
    bands: str | Sequence[str],
    scene: str | Path = "landsat",
    instrument: str | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    shift: float = 0.0,
    ghosts: bool = True,
    fields: Mapping[str, FringeField | str | Path] | None = None,
    progress: Progress = lambda _: None,
) -> DetectorFrame:
    """What a whole detector records of one scene in one frame: each band's zone, rows of no band dark.

    bands : as ``bands_of`` takes them, or their names; scene : a name or a file, placed on all rows from the first of
    the lowest zone to the last of the highest; fields : of bands, or their files; else as ``frames.frame``.

    Raises InputError, EmptyBeamError, MethodLimitError.
    """
    check_shift(shift)
    loaded = load_instrument(instrument)
    named = bands_of(loaded, bands if isinstance(bands, str) else ",".join(bands))
    across = _across(loaded, named)
    if scene != "landsat":
        for band in named:  # what is too small is refused before anything is traced
            place_scene(loaded.band(band), across, scene, shift)
    parts = []
    for band in named:
        watch = Stopwatch()
        traced = field_of(loaded, band, instrument, tolerance, (fields or {}).get(band), "landsat", 0.0, progress)
        watch.lap("field")
        parts.append(framed(loaded, traced, scene, shift, ghosts, progress, watch, across))
    return assembled(loaded, parts)


def assembled(instrument: Instrument, parts: Sequence[Frame]) -> DetectorFrame:
    """Frames of bands of one detector, put where their zones lie. Raises InputError for zones that overlap."""
    parts = tuple(sorted(parts, key=lambda part: part.rows))
    detector = instrument.band(parts[0].band).document.detector
    pixel = instrument.band(parts[0].band).pixel
    x, y = ((np.arange(count) - 0.5 * (count - 1)) * pixel for count in (detector.columns, detector.rows))
    frame, nominal, opd = (np.zeros((detector.rows, detector.columns)) for _ in range(3))
    band = np.full(detector.rows, "", dtype=f"U{max(len(part.band) for part in parts)}")
    for part in parts:
        rows, columns = slice(*part.rows), slice(*part.columns)
        if np.any(band[rows] != ""):
            raise InputError("detector frame", "rows", list(part.rows), f"{part.band} overlaps another band's zone",
                             "name bands of different rows")  # fmt: skip
        band[rows] = part.band
        for whole, own in ((frame, part.frame), (nominal, part.nominal), (opd, part.opd_m)):
            whole[rows, columns] = own
    return DetectorFrame(
        detector.surface, np.asarray(x), np.asarray(y), band, frame, nominal, opd, max(part.error for part in parts),
        parts, parts[0].scene, parts[0].shift, instrument.name, instrument.hash,
    )  # fmt: skip


def _across(instrument: Instrument, bands: Sequence[str]) -> ZoneEdges:
    """What holds the zones of all bands."""
    zones = []
    for band in bands:
        system = instrument.band(band)
        zones.append(zone_of(system, zone_rows_lit(instrument, system)[0])[0])
    every = np.array(zones)
    low, high = every.min(axis=0), every.max(axis=0)
    return float(low[0]), float(high[1]), float(low[2]), float(high[3])
