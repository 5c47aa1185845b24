"""Draws docs/rig/indenter.svg, a section through the indenter before contact and at the contact event.

Lengths in mm, drawn at SCALE px a millimetre; heights are drawn HEIGHTS times as large, as the title says.
Run it after a change: `python docs/rig/draw_indenter.py`.
"""

from __future__ import annotations

from pathlib import Path

RADIUS, BEVEL, OUTER, SHAFT = 2.5, 5.0, 9.0, 5.2  # axis to wall, to the bevel's nearest edge, to the body's end
THICK, HEIGHT, RISE = 3.0, 0.6, 0.06  # gel; face over bevel; rise of the gel at the bevel's edge
SCALE, HEIGHTS, SLOPE = 34.0, 3.0, 0.176  # px a mm; stretch of heights; tan of 10 degrees
WIDTH, PANEL = 840, 370
INK, STEEL, GEL, BASE, RED = "#1d2733", "#c9d1da", "#f6d9a8", "#8d99a6", "#b3261e"


def text(x: float, y: float, said: str, *, anchor: str = "middle", colour: str = INK, size: int = 18) -> str:
    """A line of text."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}" font-size="{size}">{said}</text>'


def arrow(x0: float, y0: float, x1: float, y1: float) -> str:
    """A line with a head at both ends."""
    ends = 'marker-start="url(#head)" marker-end="url(#head)"'
    return (
        f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{INK}" stroke-width="1.2" {ends}/>'
    )


def dashes(x0: float, y0: float, x1: float, y1: float) -> str:
    """A thin broken line."""
    return (
        f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{INK}" '
        'stroke-width="0.8" stroke-dasharray="4 4"/>'
    )


def shape(points: list[tuple[float, float]], fill: str) -> str:
    """A filled polygon."""
    places = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polygon points="{places}" fill="{fill}" stroke="{INK}" stroke-width="1.3" stroke-linejoin="round"/>'


def panel(top: float, depth: float, title: str, *, title_at: float, labelled: bool) -> list[str]:
    """One section: the gel on its base, and the indenter whose face stands at `depth` (above 0: in the gel)."""
    middle, stretch = 325.0, SCALE * HEIGHTS

    def at(x_mm: float, depth_mm: float) -> tuple[float, float]:
        return middle + SCALE * x_mm, top + 215 + stretch * depth_mm

    def surface(x_mm: float) -> float:
        off = abs(x_mm) - RADIUS
        if depth <= 0:
            return 0.0
        return depth if off < 0 else -RISE * 2.6 * off * 2.718 ** (-off / 1.25) / 1.25

    left, right = -9.0, 9.6
    steps = [left + k * (right - left) / 372 for k in range(373)]
    gel = [at(x, surface(x)) for x in steps] + [at(right, 1.1), at(left, 1.1)]
    base = [at(left, 1.1), at(right, 1.1), at(right, 1.32), at(left, 1.32)]
    face, edge = depth, depth - HEIGHT
    end = edge - SLOPE * (OUTER - BEVEL) * 0.5
    body = [at(-RADIUS, face), at(RADIUS, face), at(RADIUS, edge - 0.42), at(BEVEL - 0.35, edge - 0.42),
            at(BEVEL, edge), at(OUTER, end), at(OUTER, edge - 0.8), at(-RADIUS, edge - 0.8)]  # fmt: skip
    said = [shape(gel, GEL), shape(base, BASE), shape(body, STEEL)]
    said.append(text(20, top + title_at, title, anchor="start", size=20))
    x, y = at(-7.4, 0.75)
    said += [
        text(x, y, "gel"),
        text(at(0, 1.24)[0], at(0, 1.24)[1] + 3, "rigid base, camera below", colour="#fff"),
    ]
    axis = at(0, edge - 0.85)
    said.append(dashes(axis[0], axis[1], axis[0], at(0, 1.1)[1]))
    if labelled:
        said += labels(at, face, edge, end)
    else:
        said += contact_labels(at, face, edge)
    return said


def labels(at, face: float, edge: float, end: float) -> list[str]:  # type: ignore[no-untyped-def]
    """The dimensions of the indenter."""
    (x0, y0), (x1, _) = at(0, face - 0.1), at(RADIUS, face)
    said = [arrow(x0, y0, x1, y0), text((x0 + x1) / 2, y0 - 7, "radius_mm", size=15)]
    (x0, y0), (x1, _) = at(0, edge - 0.62), at(BEVEL, edge)
    said += [arrow(x0, y0, x1, y0), text((x0 + x1) / 2 + 10, y0 - 6, "bevel_distance_mm", size=15)]
    said.append(dashes(x1, y0, x1, at(0, edge)[1]))
    (x0, y0), (_, y1) = at(RADIUS + 1.25, edge), at(0, face)
    said += [arrow(x0, y0, x0, y1), text(x0 + 8, (y0 + y1) / 2 + 9, "height_mm", anchor="start", size=17)]
    said += [dashes(x0 - 14, y1, at(RADIUS, 0)[0], y1), dashes(x0 - 10, y0, at(BEVEL, 0)[0], y0)]
    x0, y0 = at(OUTER + 0.25, end)
    said += [
        text(x0, y0 - 4, "bevel", anchor="start"),
        text(x0, y0 + 16, "bevel_angle_deg", anchor="start", size=17),
    ]
    x0, y0 = at(-RADIUS - 0.3, face - 0.15)
    said += [text(x0, y0, "punch", anchor="end"), text(x0, y0 + 19, "punch face below", anchor="end", size=17)]
    return said


def contact_labels(at, face: float, edge: float) -> list[str]:  # type: ignore[no-untyped-def]
    """What is measured at the contact event."""
    x0, y0 = at(BEVEL, edge)
    said = [f'<circle cx="{x0:.1f}" cy="{y0:.1f}" r="6" fill="none" stroke="{RED}" stroke-width="2.5"/>']
    x1, y1 = at(2.75, 0.45)
    said.append(
        f'<line x1="{x1 + 60:.1f}" y1="{y1 - 14:.1f}" x2="{x0 + 2:.1f}" y2="{y0 + 7:.1f}" stroke="{RED}"/>'
    )
    said.append(text(x1, y1, "contact event: the bevel meets the risen gel", anchor="start", colour=RED))
    (x0, y0), (_, y1) = at(-4.6, 0), at(0, face)
    said += [arrow(x0, y0, x0, y1), text(x0 - 8, (y0 + y1) / 2 + 5, "depth w", anchor="end")]
    said += [dashes(at(-9, 0)[0], y0, at(9.6, 0)[0], y0), dashes(x0 - 8, y1, at(-RADIUS, 0)[0], y1)]
    said.append(text(at(9.5, 0)[0], y0 + 17, "untouched surface", anchor="end", size=17))
    return said


def main() -> None:
    head = (
        '<marker id="head" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" '
        f'orient="auto-start-reverse"><path d="M0 0 L10 5 L0 10 z" fill="{INK}"/></marker>'
    )
    tall = 2 * PANEL - 70
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {tall}" font-family="sans-serif">',
        f'<rect width="{WIDTH}" height="{tall}" fill="#fff"/><defs>{head}</defs>',
        *panel(0, -0.1, "Before contact (heights three times as large)", title_at=24, labelled=True),
        *panel(PANEL - 80, HEIGHT - RISE, "At the contact event", title_at=104, labelled=False),
        "</svg>",
    ]
    Path(__file__).with_name("indenter.svg").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
