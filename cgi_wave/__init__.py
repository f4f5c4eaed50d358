"""Ghosts, pupil fields, overlap contrast and interferograms of imaging static Fourier-transform spectrometers.

The public names below come from the modules beside them, loaded at first use: ``import cgi_wave`` itself costs nothing.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

#: Default bound, relative to the nominal modulation, below which a pair of beams is left out. Finer ones cost time and
#: leave the error bars of the reference instrument as they are (validation/tolerance.py).
DEFAULT_TOLERANCE = 1e-3

#: Public name: the module that holds it.
_HOME = {
    # the instrument
    "load_instrument": "optics.system",
    "import_lens": "lensfile.load",
    # paths, rays, spots
    "find_paths": "rays.paths",
    "parse_path": "rays.paths",
    "nominal_direction": "rays.beams",
    "rays_from_direction": "rays.beams",
    "rays_to_point": "rays.beams",
    "spot": "rays.beams",
    # light walked through by lots
    "flux": "rays.flux",
    "from_direction": "rays.flux",
    "from_field": "rays.flux",
    "lambertian": "rays.flux",
    # pupil fields, contrasts, PSFs
    "HopkinsPair": "wave.hopkins",
    "contrast": "wave.methods.auto",
    "gram": "wave.gram",
    "polychromatic": "wave.gram",
    "contrast_eq4": "wave.eq4",
    "contrast_stationary": "wave.eq4",
    "fit_field": "wave.field",
    "overlap": "wave.overlap",
    "overlap_spectrum": "wave.overlap",
    "psf": "wave.psf",
    # spectra
    "Filter": "scene.filters",
    "coherence": "scene.coherence",
    "load_spectrum": "scene.spectrum_file",
    "toa_radiance": "scene.radiance",
    # scenes
    "Plume": "scene.plume",
    "Scene": "scene.ground",
    "band_scene": "budget.scenes",
    "canvas": "budget.scenes",
    "landsat_crop": "scene.landsat",
    "load_scene": "scene.ground_file",
    "save_scene": "scene.ground_file",
    "with_column": "scene.column",
    "with_plume": "scene.plume",
    # interferograms, M, B and NMA
    "plot_psi": "fringes.plots",
    "retrieve": "fringes.nma",
    "synthesise": "fringes.psi",
    # one field point, one band
    "field_point": "budget.fieldpoint",
    "band_setting": "budget.setting",
    "ghost_rows": "budget.ghosts",
    "point_source": "budget.pointsource",
    "polarisation_bound": "budget.polarisation",
    "select_ghosts": "budget.select",
    "table1": "budget.table1",
    # what ghosts cost whom, and what would help
    "attribute": "budget.attribution",
    "cost_table": "budget.cost_table",
    "interferogram_terms": "fringes.psi",
    "rank_remedies": "ranking",
    # the main job
    "analyse": "analysis",
    "analyse_band": "analysis",
    "list_bands": "analysis",
    "zone_rows": "analysis",
    # frames over scenes, the scroll
    "Detector": "fringes.detector",
    "detector_frame": "mosaic",
    "frame": "frames",
    "fringe_field": "fields",
    "load_field": "fringes.field_file",
    "point_parts": "pointparts",
    "save_field": "fringes.field_file",
    "scroll": "scrolling",
    # pictures
    "plot_contrast": "report.plots",
    "plot_detector": "report.frame_plots",
    "plot_frame": "report.frame_plots",
    "plot_irradiance": "report.plots",
    "plot_layout": "report.plots",
    "plot_nma_error": "report.frame_plots",
    "plot_point": "report.frame_plots",
    "plot_point_spectrum": "report.frame_plots",
    "plot_psf": "report.plots",
    "plot_waterfall": "report.frame_plots",
}

__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> Any:
    """A public name, from its module. Raises AttributeError for any other."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
