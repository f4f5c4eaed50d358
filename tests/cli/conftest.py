"""A small made-up analysis in the place of the real one: two nominal beams with fringes, and one ghost."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import cgi_wave
from cgi_wave.budget.table1 import table1
from cgi_wave.cli import commands
from cgi_wave.fringes.coherency import Coherency, Pair
from cgi_wave.fringes.nma import retrieve
from cgi_wave.fringes.psi import synthesise
from cgi_wave.report import build
from cgi_wave.report.page import SURFACE_COLUMNS

GHOST = {
    "label": "filter.front:r",
    "path": "L1 filter.front:r detector",
    "order": 1,
    "transmission": 2.5e-3,
    "transmission_fields": [4e-3, 1e-3],
    "rms_x_m": 1.5e-4,
    "rms_y_m": 2.5e-4,
    "contrast_eq4": 0.05,
    "contrast": 0.0123,
    "contrast_error": 1e-6,
    "method": "panels",
    "contrast_uniform": None,
    "contrast_uniform_error": None,
    "opd_m": 1.33e-3,
    "fringes": 10.0,
}
COST = {
    **dict.fromkeys((column.key for column in SURFACE_COLUMNS), 0.01),
    "name": "filter.front",
    "coating": "bandpass",
    "ghosts": 1,
    "contrast_nominal": None,
}
COSTS = {
    "surfaces": [COST],
    "families": [COST | {"name": "filter.front:r"}],
    "total": dict.fromkeys(
        ("offset", "modulation", "nma", "nma_error", "share_offset", "share_modulation", "share_nma"), 0.02
    ),
}
LAYOUT = {
    "title": "A mirror",
    "axes": ("z", "y"),
    "surfaces": [{"name": "M", "points_m": [[0, 0], [0, 1]], "name_at_m": [0, 1], "outward": [0.0, 1.0]}],
    "rays": [],
}


def made_up_field(index):
    sigma = np.linspace(1.30e6, 1.32e6, 401)
    pair = Pair(0, 1, sigma[200:201], np.ones(1, complex), np.zeros(1), np.array([1e-5]), 1e-3, "closed form")
    ghost = [Pair(m, 2, sigma[200:201], np.zeros(1, complex), np.zeros(1), np.zeros(1), 0.0, "zero") for m in (0, 1)]
    coherency = Coherency(
        ("arm1", "arm2", "ghost"),
        np.array([0, 0, 1]),
        np.array([0, 0, 1]),
        np.array([0.25, 0.25, 0.01]),
        (pair, *ghost),
    )
    y = 15e-6 * np.arange(-225, 225)
    psi = synthesise(coherency, sigma, np.exp(-(((sigma - 1.31e6) / 2e3) ** 2)), y)
    picture = {"label": "arm1", "x_m": [-1e-6, 1e-6], "y_m": [-1e-6, 1e-6]}
    return SimpleNamespace(
        index=index,
        x_m=0.0,
        y_m=1e-3 * index,
        psi=psi,
        retrieval=retrieve(psi),
        spots=[picture | {"irradiance": [[1.0]], "power": 1.0, "rms_x_m": 1e-6, "rms_y_m": 1e-6}],
        psfs=[picture | {"psf": [[1.0, 0.5], [0.1, 0.0]], "share": 0.9, "method": "padded FFT"}],
    )


def made_up_analysis(names, instrument, fields):
    bands = {
        name: SimpleNamespace(
            name=name,
            fields=fields,
            table1=table1(name, [field.retrieval for field in fields]),
            ghosts=[GHOST],
            ghost_count=1,
            plan="kept 3, left out 0",
            costs=COSTS,
        )
        for name in names
    }
    return SimpleNamespace(
        bands=bands, instrument_name=instrument or "reference", instrument_hash="abc", provenance={}, seconds=1.0
    )


@pytest.fixture
def costs():
    """What surfaces cost, made up."""
    return COSTS


@pytest.fixture(scope="session")
def fields():
    return (made_up_field(0), made_up_field(1))


@pytest.fixture
def analysis(monkeypatch, fields):
    """The stand-in module; a test may replace ``analyse`` in it. Pictures are coarse, to be quick."""
    monkeypatch.setattr(build, "DPI", 10)
    module = ModuleType("cgi_wave.analysis")
    module.list_bands = lambda instrument: ["NIR", "VIS"]

    def analyse(names, instrument, tolerance, progress, cross_family):
        print("chatter of a library")
        progress("field 1 of 2")
        return made_up_analysis(names, instrument, fields)

    def plan_band(name, instrument, tolerance, progress):
        print("chatter of a library")
        progress("field 1 of 2")
        return None, "kept 3, left out 0"

    module.analyse = analyse
    module.plan_band = plan_band
    monkeypatch.setattr(commands, "_views", lambda band, instrument: [LAYOUT])
    monkeypatch.setitem(sys.modules, "cgi_wave.analysis", module)
    monkeypatch.setattr(cgi_wave, "analysis", module, raising=False)
    return module
