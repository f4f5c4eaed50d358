"""Instruments with a handful of surfaces, for which closed forms exist, and the published lenses of tests/data."""

from pathlib import Path

from cgi_wave.optics.system import OpticalSystem, from_document, load_instrument

DATA = Path(__file__).parents[1] / "data"
WIDE = {"half_width_mm": [1000.0, 1000.0]}


def surface(name, after, thickness=0.0, radius=None, aperture=100.0, **fields):
    """One surface; lengths in mm. ``aperture``: radius of a circle, or a table. ``conic`` makes it a conic."""
    shape = {} if radius is None else {"shape": "conic" if "conic" in fields else "sphere", "radius_mm": radius}
    size = aperture if isinstance(aperture, dict) else {"radius_mm": aperture}
    return {"name": name, "after": after, "thickness_mm": thickness, "aperture": size} | shape | fields


def detector(**fields):
    """The recording surface, 2 m wide."""
    return surface("detector", "", aperture=WIDE, nominal="absorb", **fields)


def frame(name, before, *surfaces, **fields):
    """A frame with its surfaces."""
    return {"name": name, "before": before, "surface": list(surfaces)} | fields


def document(frames, space, radius=5.0, wavelength=500.0, coating=None, entrance=None, **rest):
    """An instrument as plain data: first space in front, indices of the spaces given as numbers (1.0: air)."""
    return {
        "name": "small",
        "glass": {f"n{n}": float(n) for n in space.values() if n != 1.0},
        "space": {name: "air" if n == 1.0 else f"n{n}" for name, n in space.items()},
        "coating": {"none": {}, "bare": {"bare": True}, "mirror": {"reflectance": 1.0, "transmittance": 0.0}}
        | (coating or {}),
        "entrance": {"space": next(iter(space)), "radius_mm": radius, "back_off_mm": 10.0} | (entrance or {}),
        "detector": {"surface": "detector", "pixel_um": 10.0, "columns": 100, "rows": 100},
        "frame": frames,
        "band": {
            "B": {
                "zone_rows": [0, 100],
                "wavelengths_nm": [wavelength],
                "filter": {"centre_nm": wavelength, "fwhm_nm": 1e-3 * wavelength},
                "spectrum": {"kind": "solar"},
                "target_opd_mm": 0.0,
            }
        },
    } | rest


def build(*args, **kwargs) -> OpticalSystem:
    """``document`` resolved for its only band."""
    return from_document(document(*args, **kwargs)).band("B")


def published(name) -> OpticalSystem:
    """A published lens of tests/data."""
    instrument = load_instrument(DATA / f"{name}.toml")
    return instrument.band(instrument.bands[0])


def singlet(distance, n=1.5, radius=100.0, **entrance) -> OpticalSystem:
    """A thin (1 mm) equiconvex lens 20 mm behind the pupil, the detector ``distance`` mm behind it."""
    faces = (surface("front_face", "glass", 1.0, radius, 8.0, coating="bare"),
             surface("back_face", "back", distance, -radius, 8.0, coating="bare"))  # fmt: skip
    lens = frame("lens", "front", *faces, detector(), start_mm=20.0)
    return build([lens], {"front": 1.0, "glass": n, "back": 1.0}, radius=2.0, entrance=entrance)


def michelson(
    port="front", ar=0.0, rho=0.0, splitter=None, wavelength=500.0, extra=0.0, tilt=0.0, mirror_phase=180.0
) -> OpticalSystem:
    """A cube of 20 mm (n = 1.5) with a mirror 5 mm behind each arm's face, mirror 2 moved out by ``extra`` mm.

    Detectors stand in both ports; ``port`` ("front" or "back") says which one records. ar: reflectance of the four
    faces of the cube; rho: of the detectors; tilt: of mirror 2 about x, degrees.
    """
    half = {"half_width_mm": [10.0, 10.0]}
    coating = {
        "ar": {"reflectance": ar, "transmittance": 1.0 - ar},
        "splitter": splitter or {"reflectance": 0.5, "transmittance": 0.5, "reflect_phase_deg": 90.0},
        "silver": {"reflectance": 1.0, "transmittance": 0.0, "reflect_phase_deg": mirror_phase},
        "detector": {"reflectance": rho, "transmittance": 0.0},
    }
    plane = {"aperture": half, "coating": "ar"}
    silver = {"aperture": half, "coating": "silver", "nominal": "reflect"}
    record = {"aperture": half, "coating": "detector", "nominal": "absorb"}
    centre = {"attach": "cube_in", "shift_mm": [0.0, 0.0, 10.0]}
    frames = [
        frame("input", "room", surface("cube_in", "cube_a", **plane), start_mm=30.0),
        frame("diagonal", "cube_a",
              surface("splitter", "cube_b", aperture={"half_width_mm": [14.2, 10.0]}, coating="splitter",
                      nominal="both"),
              rotate_deg=[0.0, -45.0, 0.0], **centre),
        frame("arm1", "cube_a", surface("cube_arm1", "gap1", 5.0, **plane), surface("mirror1", "", **silver),
              rotate_deg=[0.0, 90.0, 0.0], start_mm=10.0, **centre),
        frame("arm2", "cube_b", surface("cube_arm2", "gap2", 5.0 + extra, **plane),
              surface("mirror2", "", tilt_deg=[tilt, 0.0, 0.0], **silver), start_mm=10.0, **centre),
        frame("exit", "cube_b", surface("cube_exit", "exit_room", 8.0, **plane), surface("front", "", **record),
              rotate_deg=[0.0, -90.0, 0.0], start_mm=10.0, **centre),
        frame("return", "room", surface("back", "", **record), shift_mm=[0.0, 0.0, -40.0],
              rotate_deg=[180.0, 0.0, 0.0]),
    ]  # fmt: skip
    space = {"room": 1.0, "cube_a": 1.5, "cube_b": 1.5, "gap1": 1.0, "gap2": 1.0, "exit_room": 1.0}
    inter = {
        "splitter": "splitter",
        "arm1": {"surfaces": ["cube_arm1", "mirror1"]},
        "arm2": {"surfaces": ["cube_arm2", "mirror2"]},
    }
    return build(frames, space, radius=2.0, wavelength=wavelength, coating=coating, interferometer=inter,
                 entrance={"half_field_deg": [0.5, 0.5]},
                 detector={"surface": port, "pixel_um": 10.0, "columns": 100, "rows": 100})  # fmt: skip
