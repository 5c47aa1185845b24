"""Figures of records and the workbench as a notebook shows them; the methods `plot` of the records lead here."""

from __future__ import annotations

import atexit
import base64
import re
import subprocess
import sys
from functools import partial
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from calibration.diagnosis.diagnosis import Diagnosis
from calibration.report.drawing import drawn_points, fitted_lines
from calibration.report.misfit import BASE, error_falls, residual_strips
from calibration.report.wording import in_words
from calibration.result.result import CalibrationResult
from calibration.tasks.compare import Comparison, as_comparison
from tactilevision.errors import InputError, library
from tactilevision.plots import calibration as indentation, misfit, style
from tactilevision.plots.height import draw_map
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import HeightMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 110  # of a figure in a notebook: 1,000 px across
FRAME_PX = 900  # height of the workbench's frame


def plot_height(height: HeightMap, *, std: bool = False) -> Figure:
    """Draw a height map (H, W) with a colour bar in mm and a scale bar; with `std` also the depth's deviation."""
    return shown(draw_map(height, std=std))


def plot_fit(result: CalibrationResult) -> Figure:
    """Draw the fitted law through the measured forces over depth, and its residual."""
    fitted = result.fitted
    return shown(indentation.draw_fit(drawn_points(fitted, ()), fitted_lines(fitted)))


def plot_residuals(found: Diagnosis) -> Figure:
    """Draw the residuals of the base model and of the last one against everything recorded."""
    last = as_comparison(found).models[-1]
    named = " + ".join(map(in_words, last.effects))
    fits = {BASE: found.fits.base} | ({f"+ {named}": found.fits.fitted} if named else {})
    scored = [found.search.covariates_before, found.search.covariates][: len(fits)]
    return shown(misfit.draw_strips(residual_strips(fits, scored)))


def plot_fall(found: Comparison | Diagnosis) -> Figure:
    """Draw the error of each model next to the repeatability: of the force, or of the depth where that changes."""
    compared = as_comparison(found) if isinstance(found, Diagnosis) else found
    return shown(misfit.draw_error_fall(error_falls(compared)[0]))


def shown(figure: Figure) -> Figure:
    """Return the figure, which a notebook shows as a picture with or without pyplot."""
    figure._repr_html_ = partial(_as_image, figure)  # type: ignore[method-assign]
    return figure


def _as_image(figure: Figure) -> str:
    style.choose_fonts(figure)
    file = BytesIO()
    figure.savefig(file, format="png", dpi=DPI)
    return f'<img alt="figure" src="data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}">'


class OpenWorkbench:
    """A workbench in a process of its own, whose page a notebook shows in a frame; `close` ends it."""

    def __init__(self, address: str, process: subprocess.Popen[str]) -> None:
        self.address, self._process = address, process
        atexit.register(self.close)

    def _repr_html_(self) -> str:
        return f'<iframe src="{escape(self.address)}" title="workbench" width="100%" height="{FRAME_PX}"></iframe>'

    def close(self) -> None:
        """End the process; the state stays in its folder."""
        if self._process.returncode is None:
            self._process.terminate()
            self._process.communicate()


def open_workbench(recording: Recording | Path | str, *, out: Path | str = "workbench_out") -> OpenWorkbench:
    """Open the workbench of a recording and show its page in a frame of the notebook.

    The state is kept in the folder `out`. The notebook must be shown on this machine, as a page that it serves on
    localhost may frame the workbench, and no other. Raises InputError where the recording cannot be opened.
    """
    library("plotly", extra="workbench", where="open_workbench")
    path = recording.path if isinstance(recording, Recording) else read_recording(recording).path
    command = [sys.executable, "-m", "tactilevision", "workbench", str(path), "--out", str(out)]
    process = subprocess.Popen([*command, "--no-browser", "--framed"], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    found = next(filter(None, (re.search(r"http://\S+", line) for line in process.stdout)), None)
    if found is None:
        process.communicate()
        remedy = f"Run `tactilevision workbench {path}` in a terminal to see why."
        raise InputError("the workbench did not open", where=path, remedy=remedy)
    return OpenWorkbench(found[0], process)
