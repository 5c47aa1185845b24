"""Figure of an exported contact law: force of the fitted shape, and errors at the shapes that were not fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactilevision.export.material import GOAL, ExportedMaterial
from tactilevision.plots import style
from tactilevision.plots.style import LOOK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PERCENT = 100  # of a relative error


@style.house_look
def draw_export(exported: ExportedMaterial) -> Figure:
    """Draw the layer's force and the law's over depth, and the law's relative error for each shape."""
    figure, (forces, errors) = style.new_figure(columns=2)
    fitted = exported.compared[0]
    forces.plot(fitted.depth_mm, fitted.layer_N, "o", ms=LOOK.mark, color=style.GREY, label="elastic layer")
    forces.plot(fitted.depth_mm, fitted.law_N, color=style.BLUE, label=f"{exported.program.title}: {fitted.shape}")
    forces.set(xlabel="depth (mm)", ylabel="force (N)", title="Fitted shape")
    style.zero_line(errors)
    errors.axhspan(-PERCENT * GOAL, PERCENT * GOAL, color=style.GREY, alpha=LOOK.band, lw=0, label="within 5 %")
    colours = (style.BLUE, style.ORANGE, style.GREEN, style.PURPLE, style.SKY)
    for one, colour in zip(exported.compared, colours, strict=True):
        if one.depth_mm.size:
            label = f"{exported.program.title}: {one.shape}"
            errors.plot(one.depth_mm, PERCENT * (one.law_N / one.layer_N - 1), color=colour, label=label)
    errors.set(xlabel="depth (mm)", ylabel="law over layer - 1 (%)", title="Fitted and other shapes")
    return style.legend_below(figure, columns=2)
