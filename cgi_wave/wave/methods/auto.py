"""The methods by name, what a step of each costs on this machine, and the cheapest one that keeps a tolerance."""

from __future__ import annotations

import json
import math
import os
import platform
import tempfile
from collections.abc import Callable, Iterable
from functools import lru_cache
from importlib import import_module
from typing import Any

from cgi_wave import __version__
from cgi_wave.errors import CgiWaveError, InputError, MethodLimitError
from cgi_wave.wave.field import PupilField
from cgi_wave.wave.hopkins import HopkinsPair
from cgi_wave.wave.methods.base import Estimate, OverlapMethod
from cgi_wave.wave.methods.plans import cache_folder

#: Name on the command line: module and class. In the order in which equals are preferred.
METHODS = {
    "boundary": "quadrature.Boundary",
    "panels": "quadrature.Panels",
    "fft": "fft.WindowFft",
    "pruned-fft": "fft.PrunedFft",
    "matrix": "matrix.MatrixFourier",
    "chirp-z": "matrix.ChirpZ",
    "nufft": "nufft.Nufft",
    "fresnel": "propagation.Fresnel",
    "huygens": "huygens.Huygens",
}
#: What ``auto`` chooses from: all but direct summation, which is an oracle and never the cheapest.
CHOICE = tuple(name for name in METHODS if name != "huygens")
#: Not contrasts with a phase: what Eq. 4 imitates, and its counterpart with diffraction. Never chosen by ``auto``.
INCOHERENT = {"geometric": "geometric.Geometric", "incoherent": "incoherent.Incoherent"}
#: Waves of the two pairs on which calls and steps are priced: few, and so many that the steps outweigh the call.
_FEW, _MANY = 0.25, {"boundary": 1000.25, "panels": 50.25}
_MANY_ON_GRIDS = 10.25
_REFERENCE_TOLERANCE = 0.03
_FILE = "prices.json"


@lru_cache
def method(name: str) -> OverlapMethod:
    """A method by its name. Raises InputError for an unknown one."""
    known = METHODS | INCOHERENT
    if name not in known:
        raise InputError("contrast", "method", name, "unknown", f"one of auto, {', '.join(known)}")
    module, cls = known[name].split(".")
    made: OverlapMethod = getattr(import_module(f"cgi_wave.wave.methods.{module}"), cls)()
    return made


@lru_cache
def prices() -> dict[str, tuple[float, float]]:
    """(seconds of a call, seconds of a step) of every method on this machine, one thread.

    From two pairs of circular pupils; measured once per version and machine, and kept in the cache folder. A method
    whose library is absent has none.
    """
    key = f"{__version__} {platform.machine()} {platform.processor()} {os.cpu_count()} {platform.python_version()}"
    try:
        kept = json.loads((cache_folder() / _FILE).read_text(encoding="utf-8"))
        if kept["key"] == key:
            return {name: (float(call), float(step)) for name, (call, step) in kept["prices"].items()}
    except (OSError, ValueError, KeyError, TypeError):  # none yet, or not ours to read: measure
        pass
    found = {}
    for name in CHOICE:
        try:
            found[name] = _price(method(name), _MANY.get(name, _MANY_ON_GRIDS))
        except (CgiWaveError, ImportError):
            continue
    _keep({"key": key, "prices": found})
    return found


def _price(way: OverlapMethod, many: float) -> tuple[float, float]:
    times, steps = [], []
    for w020 in (_FEW, many):
        fields = HopkinsPair(w020=w020, w131=0.1 * w020, shift_x=0.3).pupil_fields()
        way.evaluate(*fields, 1.0, _REFERENCE_TOLERANCE)  # compiles, plans
        times.append(min(way.evaluate(*fields, 1.0, _REFERENCE_TOLERANCE).seconds for _ in range(3)))
        steps.append(way.cost(*fields, 1.0, _REFERENCE_TOLERANCE))
    step = max((times[1] - times[0]) / max(steps[1] - steps[0], 1.0), 1e-10)
    return max(times[0] - step * steps[0], 1e-5), step


def _keep(document: dict[str, Any]) -> None:
    """Whole or not at all; a folder that cannot be written costs the next run's measuring."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=folder, prefix=_FILE)
        with os.fdopen(handle, "w", encoding="utf-8") as out:
            json.dump(document, out)
        os.replace(name, folder / _FILE)
    except OSError:
        return


def choose(
    m: PupilField,
    l: PupilField,  # noqa: E741
    sigma: float,
    tol: float,
    names: Iterable[str] = CHOICE,
    price: Callable[[], dict[str, tuple[float, float]]] = prices,
) -> list[tuple[str, float]]:
    """Methods that promise ``tol`` on a pair of fields, cheapest first, with the seconds that each is expected to take.

    Raises MethodLimitError when none does, naming the least error that one of them can promise.
    """
    known, fit, best = price(), [], math.inf
    for name in names:
        if name not in known:
            continue
        way = method(name)
        if way.supports(m, l, sigma) is not None:
            continue
        promised = way.error_bound(m, l, sigma, tol)
        best = min(best, promised)
        call, step = known[name]
        seconds = call + step * way.cost(m, l, sigma, tol)
        # misfit of the fields is no method's fault: it is in every bound alike
        if promised <= tol + 2.0 * math.pi * sigma * (m.opl_residual + l.opl_residual) and math.isfinite(seconds):
            fit.append((name, seconds))
    if not fit:
        raise MethodLimitError(
            "auto", f"no method promises {tol:.2g} on {m.label} | {l.label}", best / tol, f"ask for {best:.2g}"
        )
    return sorted(fit, key=lambda item: item[1])


def evaluate(m: PupilField, l: PupilField, sigma: float, tol: float, name: str = "auto") -> Estimate:  # noqa: E741
    """γ of two fields by a method of METHODS or INCOHERENT, or by the cheapest one that keeps ``tol``.

    A method that gives up on the way (a node cap, an empty cut) is followed by the next one.
    """
    if name != "auto":
        way = method(name)
        reason = way.supports(m, l, sigma)
        if reason is not None:
            raise MethodLimitError(way.name, reason, math.inf, "use another method, or auto")
        return way.evaluate(m, l, sigma, tol)
    last: MethodLimitError | None = None
    for candidate, _ in choose(m, l, sigma, tol):
        try:
            return method(candidate).evaluate(m, l, sigma, tol)
        except MethodLimitError as limit:
            last = last or limit
    assert last is not None  # choose gives at least one
    raise last


def contrast(pair: HopkinsPair, tol: float = 1e-8, name: str = "auto") -> Estimate:
    """γ of two circular pupils. "auto" and "boundary" need no fields and take the circles as they are.

    Raises InputError for an unknown method, MethodLimitError where one does not reach ``tol``.
    """
    from cgi_wave.wave.hopkins import contrast as along_the_boundary

    if name in ("auto", "boundary"):
        return along_the_boundary(pair, tol)
    return evaluate(*pair.pupil_fields(), 1.0, tol, name)
