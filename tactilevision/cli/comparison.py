"""A comparison written into its folder: numbers, figures and page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from tactilevision.cli import console

if TYPE_CHECKING:
    from calibration.report.comparison_report import Pictures
    from calibration.tasks.compare import Compared, Comparison
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.records.misfit import ErrorFall


def write_comparison(
    found: Comparison,
    folder: FigureFolder,
    *,
    title: str,
    try_next: Sequence[tuple[str, str]] = (),
    state: str = "",
) -> None:
    """comparison.json, the figures and report.html. `try_next`: what for, and how."""
    from calibration.report.comparison_report import comparison_page
    from calibration.report.error_fall import error_fall_of_comparison, error_fall_of_picture
    from tactilevision.files import write_json, write_text

    write_json(folder.path / "comparison.json", content_of(found))
    both = [error_fall_of_comparison(found), *error_fall_of_picture(found.pictured)]
    falls = sorted(both, key=lambda fall: (len(fall.models) == 1, fall.reached))  # what changes, then what is off
    page = comparison_page(
        title, found, falls, pictures=_pictures(found, falls, folder), try_next=try_next, state=state
    )
    write_text(folder.path / "report.html", page)


def content_of(found: Comparison) -> list[dict[str, object]]:
    """The content of comparison.json: the last model of the force names the plain errors worth a try."""
    content = found.as_json()
    content[-1]["suggested"] = list(found.suggested)
    return [*content, *(_of_picture(model, found.pictured[0]) for model in found.pictured)]


def _of_picture(model: Compared, base: Compared) -> dict[str, object]:
    """A model of the depth that the picture reads."""
    from calibration.diagnosis.vision_depth_check import face_error_mm

    return {
        "name": model.name,
        "effects": list(model.effects),
        "parameters": {name: estimate.as_json() for name, estimate in model.parameters},
        "rms_error_mm": {
            "held_out_before": base.held_out_N,
            "held_out_after": model.held_out_N,
            "floor": model.repeatability_N,
            "faces_before": face_error_mm(base.fitted),
            "faces_after": face_error_mm(model.fitted),
        },
    }


def _pictures(found: Comparison, falls: Sequence[ErrorFall], folder: FigureFolder) -> Pictures:
    from calibration.report.comparison_report import Pictures
    from calibration.report.error_fall import model_names
    from calibration.report.force_curves import force_curves
    from calibration.report.residual_strips import residual_strips
    from tactilevision.cli import misfit_pictures as keep

    names = model_names([model.effects for model in found.models])
    fits = dict(zip(names, (model.fitted for model in found.models), strict=True))
    moduli = [model.material.youngs_modulus for model in found.models if model.material is not None]
    curves = force_curves(fits)
    with console.progress_bar("drawing") as progress:
        return Pictures(
            fall=keep.keep_falls(falls, folder),
            presses=keep.keep_presses(curves, found.models[0].fitted.data.gel.thickness_mm, folder),
            strips=keep.keep_strips(residual_strips(fits, [model.covariates for model in found.models]), folder),
            moduli=keep.keep_moduli(names, moduli, folder),
            every_press=keep.keep_every_press(curves, folder, progress),
        )
