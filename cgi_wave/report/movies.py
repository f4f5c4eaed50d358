"""The scroll as a movie: animated GIF, or MP4 where Matplotlib finds ffmpeg."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cgi_wave.errors import InputError

if TYPE_CHECKING:
    from cgi_wave.scrolling import Scrolled

FORMATS = (".gif", ".mp4")
#: Frames per second; dots per inch, and inches of the text above the picture and of the border.
RATE, DPI, TEXT, BORDER = 8, 100, 0.35, 0.05
#: Longest side of the picture, inches.
SIDE = 5.0


def check_movie(name: str | Path, field: str = "movie") -> None:
    """Raise InputError unless a movie of this name can be written here."""
    suffix = Path(name).suffix.lower()
    if suffix not in FORMATS:
        raise InputError("command line", field, str(name), "is not a format for movies",
                         f"end the file's name in {' or '.join(FORMATS)}")  # fmt: skip
    if suffix == ".mp4":
        from matplotlib.animation import FFMpegWriter

        if not FFMpegWriter.isAvailable():
            remedy = "install ffmpeg (or set animation.ffmpeg_path in a matplotlibrc), or write a .gif"
            problem = "needs ffmpeg, which Matplotlib does not find here"
            raise InputError("command line", field, str(name), problem, remedy)


def write_movie(path: str | Path, result: Scrolled) -> None:
    """The kept frames as a movie, each with its number, on one scale of grey. Raises InputError (``check_movie``)."""
    from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    check_movie(path)
    height, width = result.stills.shape[1:]
    scale = SIDE / max(height, width)
    wide, high = max(width * scale, 1.6) + 2 * BORDER, height * scale + TEXT + BORDER
    figure = Figure(figsize=(wide, high), dpi=DPI)
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0.0, BORDER / high, 1.0, height * scale / high))
    ax.set_axis_off()
    low, top = np.percentile(result.stills, [0.2, 99.8])
    image = ax.imshow(result.stills[0], origin="lower", cmap="gray", vmin=low, vmax=top, interpolation="nearest")
    text = figure.text(0.5, 1.0 - 0.5 * TEXT / high, "", ha="center", va="center", fontsize=9)
    writer: AbstractMovieWriter = FFMpegWriter(fps=RATE) if Path(path).suffix.lower() == ".mp4" else PillowWriter(RATE)
    with writer.saving(figure, str(path), DPI):
        for number, still in zip(result.still_frames.tolist(), result.stills, strict=True):
            image.set_data(still)
            text.set_text(f"{result.band}, frame {number}")
            writer.grab_frame()
