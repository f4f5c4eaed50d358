"""Sequences of surfaces and rays for the tests of this folder, written as the kernel wants them."""

import numpy as np

from cgi_wave.kernels.trace import REFLECT, REFRACT, trace_sequence
from cgi_wave.optics.system import rotation


def place(z, tilt=(0.0, 0.0, 0.0), decentre=(0.0, 0.0), curvature=0.0, conic=0.0, n1=1.0, n2=1.0, mode=REFRACT, **rest):
    """One surface in the world: vertex (decentre, z) in m, tilt in degrees."""
    step = {"side": 0.0, "weight": 1.0, "bare": 0, "aperture": np.zeros(5), **rest}
    return {"rotation": rotation(tilt).T, "origin": np.array([*decentre, z]), "curvature": curvature, "conic": conic,
            "n1": n1, "n2": n2, "mode": mode, **step}  # fmt: skip


def run(steps, rays, footprints=False, tangent=None):
    """World rays (6, N) through the steps: rays in the last local frame, and a dict of what the kernel leaves."""
    axes, origin, rot, shift = np.eye(3), np.zeros(3), [], []
    for s in steps:
        rot.append(s["rotation"] @ axes.T)
        shift.append(axes @ (s["origin"] - origin))
        axes, origin = s["rotation"], s["origin"]
    rays = np.array(rays, dtype=float)
    count = rays.shape[1]

    def column(key):
        return np.array([s[key] for s in steps])

    out = {"opl": np.zeros(count), "power": np.ones(count), "status": np.zeros(count, dtype=np.int64),
           "clearance": np.full(count, np.inf),
           "foot": np.empty((len(steps) if footprints else 0, 2, count))}  # fmt: skip
    tangent = np.empty((0, 6, count)) if tangent is None else tangent
    trace_sequence(np.array(rot), np.array(shift), column("curvature"), column("conic"), column("n1"), column("n2"),
                   column("mode"), column("side"), column("weight"), column("bare"), column("aperture"), rays, tangent,
                   **out)  # fmt: skip
    return rays, out


def random_steps(rng, count=6):
    """Tilted, decentred conics 20 mm apart; after a mirror the next surfaces lie the other way."""
    steps, z, way, index = [], 0.02, 1.0, 1.0
    for _ in range(count):
        mode = REFLECT if rng.random() < 0.3 else REFRACT
        other = index if mode == REFLECT else rng.uniform(1.0, 1.8)
        steps.append(place(z, rng.uniform(-4, 4, 3), rng.uniform(-1e-3, 1e-3, 2), rng.uniform(-30, 30),
                           rng.uniform(-2, 1), index, other, mode))  # fmt: skip
        way, index = (-way, index) if mode == REFLECT else (way, other)
        z += way * 0.02
    return steps


def random_rays(rng, count, half_width=4e-3, slope=0.04):
    rays = np.zeros((6, count))
    rays[:2] = rng.uniform(-half_width, half_width, (2, count))
    rays[3:5] = rng.uniform(-slope, slope, (2, count))
    rays[5] = np.sqrt(1 - rays[3] ** 2 - rays[4] ** 2)
    return rays
