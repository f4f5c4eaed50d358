"""Memory of ten million rays through the full instrument, in a process of its own."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.paths import find_paths
from cgi_wave.rays.tree import grow_tree, stream_tree

Array = NDArray[np.float64]


def resident() -> int:
    """Largest memory of this process so far, bytes."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def many_rays(count: int) -> dict[str, Any]:
    """Both nominal paths and the strongest ghost of the first band, ``count`` rays over pupil and field."""
    instrument = load_instrument()
    system = instrument.band(instrument.bands[0])
    found = find_paths(system, max_order=1)
    paths = (*(path for path in found if path.order == 0), next(path for path in found if path.order == 1))
    half = np.sin(np.radians(system.document.entrance.half_field_deg))

    def fan(begin: int, end: int) -> tuple[Array, Array]:
        # A block's rays are its own, whoever asks for it, and whenever.
        u = np.random.default_rng([7, begin]).random((4, end - begin))
        r, angle = system.pupil_radius * np.sqrt(u[0]), 2.0 * np.pi * u[1]
        return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1), half * (2.0 * u[2:].T - 1.0)

    tree = grow_tree(system, paths, system.sigma0)
    stream_tree(tree, fan, 1000)  # compiled before the clock starts
    before, begun = resident(), time.perf_counter()
    got = stream_tree(tree, fan, count)
    return {
        "band": system.band, "rays": count, "paths": [path.label for path in paths], "surfaces_met": tree.visits,
        "seconds": time.perf_counter() - begun, "survivors": got.survivors.tolist(),
        "bytes_before": before, "bytes": resident(),
    }  # fmt: skip


def measure(count: int = 10_000_000) -> dict[str, Any]:
    """``many_rays`` in a fresh process."""
    code = f"import json; from validation import rays_memory; print(json.dumps(rays_memory.many_rays({count})))"
    done = subprocess.run([sys.executable, "-c", code], cwd=File(__file__).parents[1], check=True, capture_output=True)
    result: dict[str, Any] = json.loads(done.stdout)
    return result
