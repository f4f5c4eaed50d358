"""Every two-reflection ghost of the double Gauss beside batoid's ``traceSplit``, path by path.

The image plane reflects like the glass, so that eleven faces make 55 pairs. Both tracers get the same rays, apertures
and coatings: ours in a tree of the 56 paths, batoid by splitting at every face down to a power that only paths of three
reflections fall below. Batoid also follows light that leaves through the front again; that cannot be turned off.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path as File
from typing import Any

import batoid
import numpy as np
from numpy.typing import NDArray

from cgi_wave.optics.system import OpticalSystem, load_instrument
from cgi_wave.rays.paths import Path, parse_path
from cgi_wave.rays.tree import grow_tree, trace_tree

Array = NDArray[np.float64]
LENS = File(__file__).parents[1] / "tests" / "data" / "double_gauss.toml"
THETA = (0.0, 0.03)
#: Radius of the pupil, m: some ghosts lose half of their rays.
RADIUS = 10e-3
#: Between 0.02² × 0.98²² and 0.02³.
LEAST = 2e-4


def ghost_lens() -> OpticalSystem:
    """The double Gauss with an image plane that reflects 2 % like its other faces."""
    instrument = load_instrument(LENS).with_values({"image.coating": "glass"})
    return instrument.band(instrument.bands[0])


def spiral(count: int) -> Array:
    """Pupil points (count, 2), m: sunflower's seeds, even and without a random number."""
    k = np.arange(count)
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    return RADIUS * np.sqrt((k + 0.5) / count)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def all_ghosts(system: OpticalSystem) -> tuple[Path, ...]:
    """The nominal path and all that turn round at face j, then at face i before it."""
    names = [s.name for s in system.surfaces]
    coated = [i for i, s in enumerate(system.surfaces) if s.coating.reflectance > 0.0]
    texts = [" ".join(names[:-1])]
    for i, j in itertools.combinations(coated, 2):
        texts.append(
            " ".join([*names[:j], f"{names[j]}:r", *names[i + 1 : j][::-1], f"{names[i]}:r", *names[i + 1 : -1]])
        )
    return tuple(parse_path(system, text) for text in texts)


def batoid_lens(system: OpticalSystem) -> Any:
    """The same surfaces, apertures and coatings as batoid's interfaces."""
    index, items = system.index(system.sigma0), []
    for s in system.surfaces:
        clear = batoid.ObscCircle(s.aperture[1]) if s.aperture[0] == 1.0 else batoid.ObscRectangle(*2 * s.aperture[1:3])
        before = batoid.ConstMedium(index[s.before])
        behind = batoid.ConstMedium(index[s.after]) if s.after >= 0 else before
        kind = batoid.RefractiveInterface if s.coating.reflectance > 0.0 else batoid.Baffle
        item = kind(batoid.Sphere(1.0 / s.curvature) if s.curvature else batoid.Plane(), name=s.name,
                    obscuration=batoid.ObscNegation(clear), inMedium=before, outMedium=behind,
                    coordSys=batoid.CoordSys(s.origin, s.rotation.T.copy()))  # fmt: skip
        if s.coating.reflectance > 0.0:
            r = s.coating.reflectance
            item.forwardCoating = item.reverseCoating = batoid.SimpleCoating(r, 1.0 - r)
        items.append(item)
    return batoid.CompoundOptic(items, inMedium=items[0].inMedium, outMedium=items[-1].outMedium)


def batoid_rays(system: OpticalSystem, p: Array) -> Any:
    """Batoid's rays from pupil points p (N, 2), where ours start."""
    axes, centre = system.pupil_frame()
    back = system.document.entrance.back_off_mm * 1e-3
    d = np.array([*THETA, np.sqrt(1.0 - np.dot(THETA, THETA))])
    start = (np.column_stack([p, np.zeros(len(p))]) - back * d) @ axes + centre
    velocity = np.tile(d @ axes, (len(p), 1))
    return batoid.RayVector(*start.T.copy(), *velocity.T.copy(), t=-back, wavelength=1.0 / system.sigma0, flux=1.0)


def split(system: OpticalSystem, rays: Any) -> dict[str, dict[str, Any]]:
    """Batoid's answer per path: survivors, power, centroid_m, length_m. Power is what falls onto the image plane."""
    found: dict[str, dict[str, Any]] = {}
    forward, _ = batoid_lens(system).traceSplit(rays, minFlux=LEAST)
    for ray in forward:
        # A path is the names of the surfaces met: it turns round wherever the next name is the one before last.
        names = ray.path
        order = {s.name: k for k, s in enumerate(system.surfaces)}
        turns = [False, *(order[a] == order[c] for a, c in zip(names, names[2:], strict=False)), False]
        text = " ".join(f"{n}:r" if turn else n for n, turn in zip(names[:-1], turns, strict=False))
        found[text] = {"survivors": len(ray), "power": float(ray.flux.sum()) / 0.98,
                       "centroid_m": [float(ray.x.mean()), float(ray.y.mean())],
                       "length_m": float(ray.t.mean())}  # fmt: skip
    return found


def compare(count: int) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """The largest differences over all paths, and batoid's answers."""
    system = ghost_lens()
    p = spiral(count)
    paths, theirs = all_ghosts(system), split(system, batoid_rays(system, p))
    tree = grow_tree(system, paths, system.sigma0)
    ours = trace_tree(tree, p, np.array(THETA))
    both = [k for k, path in enumerate(paths) if str(path) in theirs]
    answer = [theirs[str(paths[k])] for k in both]
    alive = int((ours.survivors > 0).sum())
    return {
        "rays": count, "paths": len(paths), "alive": alive, "alive_batoid": len(theirs), "in_both": len(both),
        "fewest_survivors": int(ours.survivors[both].min()),
        "surfaces_met": tree.visits, "surfaces_met_unshared": sum(len(path.steps) + 1 for path in paths),
        "survivors_differ": sum(int(ours.survivors[k]) != a["survivors"] for k, a in zip(both, answer, strict=True)),
        "power_relative": max(abs(ours.power[k] / a["power"] - 1.0) for k, a in zip(both, answer, strict=True)),
        "centroid_m": max(float(np.abs(ours.centroid(k) - a["centroid_m"]).max())
                          for k, a in zip(both, answer, strict=True)),
        "length_m": max(abs(ours.length(k) - a["length_m"]) for k, a in zip(both, answer, strict=True)),
    }, theirs  # fmt: skip


def functions(count: int) -> tuple[Any, Any, Any]:
    """What is timed: our tree, batoid's rays (made outside the clock) and batoid's split of them."""
    system, p = ghost_lens(), spiral(count)
    tree, optic = grow_tree(system, all_ghosts(system), system.sigma0), batoid_lens(system)
    trace_tree(tree, p[:10], np.array(THETA))  # compiled before the clock starts
    return (
        lambda: trace_tree(tree, p, np.array(THETA)),
        lambda: batoid_rays(system, p),
        lambda rays: optic.traceSplit(rays, minFlux=LEAST),
    )


def store(file: File, count: int = 1500) -> None:
    """Write batoid's answers for a few rays, for the tests."""
    _, theirs = compare(count)
    document = {"source": f"batoid {batoid.__version__}, by validation/rays.py --write", "rays": count,
                "radius_m": RADIUS, "theta": list(THETA), "paths": theirs}  # fmt: skip
    file.write_text(json.dumps(document) + "\n", encoding="utf-8")
