"""Imported lens files: where surfaces stand, what bounds what, pupils and apertures, glasses, what is refused."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from cgi_wave.cli.main import status
from cgi_wave.errors import InputError
from cgi_wave.lensfile.load import import_lens
from cgi_wave.optics.system import load_instrument
from cgi_wave.rays.paths import find_paths, make_path
from cgi_wave.rays.trace import compile_sequence, trace_with_derivatives

DATA = Path(__file__).parents[1] / "data"
HEAD = "RDM Y; DIM M; EPD 4; WL 587.5618; YAN 0\nSO 0 1E11\n"


def imported(tmp_path, text, name="lens.seq", **options):
    file = tmp_path / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return import_lens(file, **options)


def placed(found):
    """Surface name → (vertex mm, normal) in the world."""
    system = found.instrument.band("design")
    return {s.name: (s.origin * 1e3, s.rotation[2]) for s in system.surfaces}


def focal_length(found):
    """Of the nominal path, mm, and the paraxial image beyond the detector, mm."""
    system = found.instrument.band("design")
    sequence = compile_sequence(system, make_path(system, found.path.steps), system.sigma0)
    ray = trace_with_derivatives(sequence, np.zeros((1, 2)), np.zeros(2), "p")
    x, q = ray.dx[0][0, 0], ray.dq[0][0, 0]
    return -1e3 / q, -1e3 * x / q


def test_double_gauss_has_the_first_order_figures_of_its_listing():
    """EFL 100.0038, BFL 61.4875 of which the image lies 0.4003 short, entrance pupil 57.9120, glasses to six digits."""
    found = import_lens(DATA / "codev_double_gauss.seq")
    efl, beyond = focal_length(found)
    assert efl == pytest.approx(100.0038, abs=6e-5)
    assert beyond == pytest.approx(0.400269, abs=6e-7)  # the solve PIM holds
    assert found.document["entrance"]["at_mm"] == pytest.approx([0, 0, 57.9120], abs=6e-5)
    assert found.document["entrance"]["radius_mm"] == 25.0
    system = found.instrument.band("design")
    printed = {656.3: (1.618769, 1.604134, 1.598744), 587.6: (1.622292, 1.607379, 1.603417),
               486.1: (1.630455, 1.614860, 1.614617)}  # fmt: skip
    for nm, indices in printed.items():
        by_page = dict(zip(system.glasses, system.index(1e9 / nm), strict=True))
        for glass, n in zip(("N-SSK2", "N-SK2", "F5"), indices, strict=True):
            assert by_page[f"specs/SCHOTT-optical/{glass}"] == pytest.approx(n, abs=5.1e-7)


def test_a_bent_axis_follows_the_light(tmp_path):
    """ADE is left-handed: a mirror of +45° sends light from +z to −y, and the axis with it."""
    text = HEAD + "S 0 10 REFL; ADE 45; BEN; CIR 5\nS 0 -20 REFL; BDE 45; BEN; CIR 5\nSI 0 0\n"
    where = placed(imported(tmp_path, text))
    # First mirror at the origin; thickness +10 along an axis that now points to +y would be against the light.
    assert where["S1"][1] == pytest.approx([0, np.sqrt(0.5), np.sqrt(0.5)])
    text = HEAD + "S 0 -10 REFL; ADE 45; BEN; CIR 5\nS 0 20 REFL; BDE 45; BEN; CIR 5\nSI 0 0\n"
    found = imported(tmp_path, text)
    where = placed(found)
    assert where["S2"][0] == pytest.approx([0, -10, 0], abs=1e-12)
    distance = where["image"][0] - where["S2"][0]
    assert np.linalg.norm(distance) == pytest.approx(20.0) and distance[1] == pytest.approx(0.0, abs=1e-12)
    assert [path.steps for path in find_paths(found.instrument.band("design"), 0, 0)] == [found.path.steps]


@pytest.mark.parametrize("name", ["lens.seq", "lens.zmx"])
def test_a_change_of_axes_is_undone(tmp_path, name):
    """REV, and the second order of a coordinate break with its numbers negated, lead back to the axis."""
    if name == "lens.seq":
        move = "XDE {0}; YDE {1}; ADE {2}; BDE {3}; CDE {4}"
        there = move.format(0.7, -0.4, 11, -7, 23)
        text = HEAD + f"S 50 0 NBK7_SCHOTT; {there}; CIR 3\nS 0 0 NBK7_SCHOTT; {there}; REV\nS 0 9\nSI 0 0\n"
    else:

        def surface(n, *lines):
            return [f"SURF {n}", *(f"  {line}" for line in lines)]

        def change(n, values):
            return surface(n, "TYPE COORDBRK", *(f"PARM {k + 1} {v}" for k, v in enumerate(values)), "DISZ 0")

        lines = ["MODE SEQ", "ENPD 4", "UNIT MM", "GCAT SCHOTT", "WAVM 1 0.5875618 1"]
        lines += surface(0, "TYPE STANDARD", "DISZ INFINITY") + change(1, (0.7, -0.4, 11, -7, 23, 0))
        lines += surface(2, "TYPE STANDARD", "CURV 0.02", "DISZ 0", "GLAS N-BK7", "DIAM 3 1")
        lines += change(3, (-0.7, 0.4, -11, 7, -23, 1)) + surface(4, "TYPE STANDARD", "DISZ 9", "DIAM 9 0")
        text = "\n".join(lines + surface(5, "TYPE STANDARD", "DISZ 0"))
    where = placed(imported(tmp_path, text, name))
    first = "S1" if name == "lens.seq" else "S2"
    assert abs(where[first][1][2]) < 0.99
    assert where["image"][0] == pytest.approx([0, 0, 9.0], abs=1e-12)
    assert where["image"][1] == pytest.approx([0, 0, 1], abs=1e-14)


def test_zemax_tilts_are_right_handed(tmp_path):
    """The chief ray of a published layout: a mirror tilted by −3.32° about x in a −z beam sends it to +y."""
    text = "\n".join(
        ["MODE SEQ", "ENPD 4", "UNIT CM", "WAVM 1 0.55 1", "SURF 0", "  TYPE STANDARD", "  DISZ INFINITY", "SURF 1",
         "  TYPE STANDARD", "  DISZ -2", "  GLAS MIRROR", "  DIAM 1 1", "SURF 2", "  TYPE COORDBRK", "  PARM 3 -3.32",
         "  DISZ 0", "SURF 3", "  TYPE STANDARD", "  GLAS MIRROR", "  DISZ 0", "  DIAM 1 1", "SURF 4",
         "  TYPE COORDBRK", "  PARM 3 3.32", "  DISZ 3", "SURF 5", "  TYPE STANDARD", "  DISZ 0"]
    )  # fmt: skip
    found = imported(tmp_path, text, "lens.zmx")
    system = found.instrument.band("design")
    sequence = compile_sequence(system, make_path(system, found.path.steps), system.sigma0)
    end = trace_with_derivatives(sequence, np.zeros((1, 2)), np.zeros(2), "p").traced.x[0] * 1e3
    assert end == pytest.approx([0.0, 30.0 * np.tan(np.radians(6.64))], rel=1e-12)


def test_a_surface_met_twice_is_one(tmp_path):
    """A Mangin mirror's front face is one face, and its glass one space."""
    text = HEAD + "S -1200 10 NBK7_SCHOTT; CIR 4\nS -1000 -10 REFL; CIR 4\nS -1200 -100\nSI 0 0\n"
    found = imported(tmp_path, text)
    assert str(found.path) == "S1 S2:r S1"
    assert list(found.document["space"].values()).count("N-BK7") == 1
    assert [path.steps for path in find_paths(found.instrument.band("design"), 0, 0)] == [found.path.steps]
    text = HEAD + "S -1200 10 NBK7_SCHOTT; CIR 4\nS -1000 -10 REFL; CIR 4\nS -1200 10 REFL; CIR 4\nSI 0 0\n"
    with pytest.raises(InputError, match="coincides with S1"):
        imported(tmp_path, text)


def test_units_scale_everything(tmp_path):
    """The same lens in inches and in centimetres, lengths and curvatures."""
    forms = {"I": 1 / 25.4, "C": 0.1, "M": 1.0}
    found = []
    for unit, k in forms.items():
        text = (f"RDM Y; DIM {unit}; EPD {8 * k!r}; WL 587.5618\nSO 0 1E13\nS {50 * k!r} {4 * k!r} NBK7_SCHOTT; STO\n"
                f"  CIR {6 * k!r}\nS {-70 * k!r} {55 * k!r}\n  CIR {6 * k!r}; ADY {0.1 * k!r}\nSI 0 0\n")  # fmt: skip
        found.append(imported(tmp_path, text))
    for other in found[:2]:
        assert focal_length(other) == pytest.approx(focal_length(found[2]), rel=1e-11)
        for mine, known in zip(
            other.document["frame"][0]["surface"], found[2].document["frame"][0]["surface"], strict=True
        ):
            for key in ("radius_mm", "thickness_mm"):
                assert mine.get(key) == (None if key not in known else pytest.approx(known[key], rel=1e-12))
            assert mine["aperture"].get("centre_mm") == (
                pytest.approx(known["aperture"]["centre_mm"]) if "centre_mm" in known["aperture"] else None
            )


def test_stop_among_mirrors_gives_way_to_the_pupil():
    """The tilted telescope: the ray along the axis through the pupil's centre passes the stop's centre."""
    kept = import_lens(DATA / "codev_three_mirror.seq", keep_stop=True)
    assert "S3" in [name for name, _ in kept.path.steps]
    found = import_lens(DATA / "codev_three_mirror.seq")
    assert str(found.path) == "S2:r S4:r S5:r"
    assert any("no surface of its own" in remark.text and remark.keyword == "S3" for remark in found.remarks)
    assert found.document["entrance"] == kept.document["entrance"]
    # The listing's own chief ray of the middle field crosses the first plane here.
    assert found.document["entrance"]["at_mm"][1] == pytest.approx(144.927530, abs=3e-6)
    tertiary = next(s for f in found.document["frame"] for s in f["surface"] if s["name"] == "S5")
    assert tertiary["aperture"] == {"half_width_mm": [66.581268, 65.453521], "centre_mm": [0.0, -112.354230]}


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "utf-8"])
def test_encodings_of_zemax(tmp_path, encoding):
    text = (DATA / "import_tilted.zmx").read_text(encoding="utf-8")
    found = imported(tmp_path, text.encode(encoding), "import_tilted.zmx")
    assert found.document == import_lens(DATA / "import_tilted.zmx").document


def test_glasses_mean_one_page_or_are_refused(tmp_path):
    lens = "S 50 4 {} ; STO; CIR 3\nS -50 40; CIR 3\nSI 0 0\n"
    with pytest.raises(InputError) as refusal:
        imported(tmp_path, HEAD + lens.format("F5"))
    for maker in ("SCHOTT", "HIKARI", "CDGM"):
        assert f"specs/{maker}-optical/F5" in refusal.value.remedy
    chosen = imported(tmp_path, HEAD + lens.format("F5"), glasses={"F5": "specs/CDGM-optical/F5"})
    assert "specs/CDGM-optical/F5" in chosen.document["glass"].values()
    # Index 1.62 at the d line, Abbe number 36.4: by definition of the number.
    dispersed = HEAD.replace("587.5618", "486.1327 587.5618 656.2725; REF 1") + lens.format("620.364")
    with pytest.raises(InputError, match="model glass"):
        imported(tmp_path, dispersed)
    found = [
        next(
            iter(
                imported(tmp_path, dispersed.replace("REF 1", f"REF {k}"), primary_only=True).document["glass"].values()
            )
        )
        for k in (1, 2, 3)
    ]
    assert found[1] == pytest.approx(1.62)
    assert (found[1] - 1) / (found[0] - found[2]) == pytest.approx(36.4, rel=1e-9)


def test_model_glass_of_zemax(tmp_path):
    """A model has index and Abbe number only: refused with two wavelengths, exact at the d line."""
    text = (DATA / "import_tilted.zmx").read_text(encoding="utf-8")
    text = text.replace("GLAS N-SF6 0 0 1.80518 25.36 0", "GLAS ___BLANK 1 0 1.62 36.4 0 1 1")
    with pytest.raises(InputError, match="model glass"):
        imported(tmp_path, text, "lens.zmx")
    found = imported(tmp_path, text, "lens.zmx", primary_only=True)
    assert 1.62 in found.document["glass"].values()
    assert len(found.document["band"]["design"]["wavelengths_nm"]) == 1


SEQ = "S 50 4 NBK7_SCHOTT; STO; CIR 3\nS -50 40; CIR 3\nSI 0 0\n"
REFUSED = {
    "asphere": SEQ.replace("CIR 3\nS -50", "ASP; A 1E-6\nS -50"),
    "is no conic" : None,
    "not supported": SEQ.replace("CIR 3\nS -50", "GRT; GRS 1\nS -50"),
    "unknown statement": SEQ.replace("CIR 3\nS -50", "QQQ 3\nS -50"),
    "blocks part": SEQ.replace("CIR 3\nS -50", "CIR OBS 1\nS -50"),
    "is an ellipse": SEQ.replace("CIR 3\nS -50", "ELX 2; ELY 3\nS -50"),
    "several": SEQ.replace("S -50 40; CIR", "S -50 40; STO; CIR"),
}  # fmt: skip


@pytest.mark.parametrize("problem", [key for key, text in REFUSED.items() if text])
def test_what_bends_light_otherwise_is_refused(tmp_path, problem):
    """With line, keyword and value; the same lens without it is read."""
    assert imported(tmp_path, HEAD + SEQ)
    with pytest.raises(InputError) as refusal:
        imported(tmp_path, HEAD + REFUSED[problem])
    assert problem in str(refusal.value)
    if problem != "several":
        assert refusal.value.field.startswith("line 3:")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("TYPE STANDARD\n  CURV 0.01 ", "TYPE TOROIDAL\n  CURV 0.01 ", "is no conic"),
        ("TYPE STANDARD\n  CURV 0.01 ", "TYPE EVENASPH\n  PARM 2 1e-6\n  CURV 0.01 ", "an asphere"),
        ("  COAT AR", "  GRIN 3", "unknown keyword of surface"),
        ("  COAT AR", "  CLAP 1 5", "blocks the middle"),
        ("UNIT MM", "UNIT FURLONG", "unknown unit"),
        ("FTYP 0", "FTYP 1", "field of another kind"),
        ("DISZ INFINITY", "DISZ 200", "is finite"),
        ("N-SF6 0", "SF6X 0", "no single page"),
        ("MODE SEQ", "MODE NSC", "not sequential"),
    ],
)
def test_what_zemax_files_are_refused_for(tmp_path, old, new, problem):
    text = (DATA / "import_tilted.zmx").read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(InputError, match=problem):
        imported(tmp_path, text.replace(old, new, 1), "lens.zmx")


def test_unknown_lines_outside_the_surfaces_are_listed(tmp_path):
    text = (DATA / "import_tilted.zmx").read_text(encoding="utf-8").replace("MODE SEQ", "MODE SEQ\nXYZZ 4")
    remarks = imported(tmp_path, text, "lens.zmx").remarks
    assert [(r.line, r.keyword) for r in remarks if r.what == "ignored"] == [(3, "XYZZ")]
    assert any(r.what == "dropped" and r.keyword == "COAT" for r in remarks)


def test_apertures_that_are_missing_are_traced(tmp_path):
    """Behind a stop in the air the beam of a field spreads by its tangent; 2 % and 0.05 mm are added."""
    text = HEAD.replace("YAN 0", "YAN 0 10") + "S 0 20; STO\nS 0 5 NBK7_SCHOTT\nS 0 20\nSI 0 0\n"
    surfaces = imported(tmp_path, text).document["frame"][0]["surface"]
    expected = (2 + 20 * np.tan(np.radians(10))) * 1.02 + 0.05
    assert surfaces[1]["aperture"]["radius_mm"] == pytest.approx(expected, rel=1e-3)


def test_a_solve_for_the_paraxial_image_is_carried_out(tmp_path):
    """Whatever distance the file gives, with the defocus on top; a mirror's distance is negative."""
    for text in (
        "S 50 4 NBK7_SCHOTT; STO; CIR 3\nS -50 {}; PIM; CIR 3\nSI 0 0.25\n",
        "S -90 {} REFL; CIR 3; PIM\nSI 0 -0.25\n",
    ):
        sign = -1.0 if "REFL" in text else 1.0
        found = imported(tmp_path, HEAD + text.format(sign * 3.0))
        assert focal_length(found)[1] == pytest.approx(-0.25, abs=1e-9)
        assert any("distance before the image set to" in remark.text for remark in found.remarks)
    assert placed(found)["image"][0][2] == pytest.approx(-45.25, abs=1e-9)


def test_a_lens_in_its_own_way_is_said_to_be(tmp_path):
    """A detector right behind the stop is met before the mirror that the file names first."""
    text = HEAD + "S 0 5 NBK7_SCHOTT; CIR 3\nS 0 10; CIR 3\nS 0 -3 REFL; CIR 3\nSI 0 0\n"
    remarks = imported(tmp_path, text).remarks
    assert [remark.keyword for remark in remarks if remark.what == "beware"] == ["nominal path"]


def test_the_command_writes_a_file_that_loads(tmp_path, capsys):
    out = tmp_path / "lens.toml"
    assert status(["import", str(DATA / "import_tilted.zmx"), "--out", str(out)]) == 0
    assert "COAT" in capsys.readouterr().out
    assert load_instrument(out).bands == ("design",)
    again = import_lens(DATA / "import_tilted.zmx")
    assert tomllib.loads(out.read_text(encoding="utf-8")) == tomllib.loads(again.toml)
    assert load_instrument(out).hash == again.instrument.hash
    assert status(["import", str(DATA / "import_tilted.zmx"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["path"] == str(again.path) and document["remarks"]
    assert status(["import", str(DATA / "cooke_triplet.toml")]) == 2
