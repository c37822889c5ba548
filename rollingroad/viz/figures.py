"""A `Chart` as a matplotlib figure: for print, for readers without scripts, for the gallery."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rollingroad.viz.charts import Band, Bars, Chart, Heat, Line, Mark, Panel, Span, Whiskers

_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "svg.fonttype": "none",
    "svg.hashsalt": "rollingroad",
}
_CHARACTERS = 92
"""Of a legend that fit beside one another in 6.4 inches."""
_CROWD = 500
"""More dots than this are pixels in an SVG: as single shapes they would be most of a page."""
_DASHES = {"": "-", "dash": "--", "dot": ":"}


def draw(chart: Chart, width: float = 6.4, *, titled: bool = False) -> Figure:
    """Return `chart` as a figure `width` inches wide, its height in proportion; `titled` where it stands alone."""
    with rc_context(_STYLE):
        figure = Figure(figsize=(width, width * chart.height / 640.0), layout="constrained")
        FigureCanvasAgg(figure)
        if titled:
            figure.suptitle(chart.title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
        count = len(chart.panels)
        if chart.beside:
            grid = figure.subplots(1, count, squeeze=False)[0]
        else:
            weights = [panel.weight for panel in chart.panels]
            grid = figure.subplots(count, 1, squeeze=False, sharex=True, height_ratios=weights)[:, 0]
        room = int(_CHARACTERS * width / 6.4 / (count if chart.beside else 1))
        named: list[str] = []
        for axes, panel in zip(grid, chart.panels, strict=True):
            named = _draw_panel(axes, panel, room, named)
            if chart.beside and any(isinstance(mark, Bars | Whiskers) for mark in panel.marks):
                axes.tick_params(labelleft=axes is grid[0])
        return figure


def svg(figure: Figure) -> str:
    """The figure as an SVG element without XML prologue; the same figure gives the same text."""
    with rc_context(_STYLE):
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None}, dpi=130)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def save(figure: Figure, path: Path) -> None:
    """Write the figure as the kind of file that the path's suffix names (png, svg, pdf), aside and renamed."""
    aside = path.with_name(path.name + ".part")
    with rc_context(_STYLE):
        figure.savefig(aside, format=path.suffix.lstrip("."), dpi=150)
    aside.replace(path)


def _draw_panel(axes: Axes, panel: Panel, room: int, said: list[str]) -> list[str]:
    """Draw `panel` with a legend `room` characters wide, unless it is `said` already; return the legend's names."""
    filled: dict[str, tuple[float, float]] = {}
    for mark in panel.marks:
        _draw_mark(axes, mark, filled)
    axes.set(xlabel=panel.x_label, ylabel=panel.y_label, title=panel.title)
    if panel.log_x:
        axes.set_xscale("log")
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if panel.y_range:
        axes.set_ylim(*panel.y_range)
    if panel.x_range:
        axes.set_xlim(*panel.x_range)
    handles, names = axes.get_legend_handles_labels()
    unique = dict(zip(names, handles, strict=True))
    if len(unique) > 1 and list(unique) != said:
        fine = all(mark.size <= 3.0 for mark in panel.marks if isinstance(mark, Line))
        axes.legend(
            unique.values(),
            unique.keys(),
            ncols=max(min(room // (max(map(len, unique)) + 8), 6), 1),
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0 if not panel.title else 1.1),
            borderpad=0.1,
            markerscale=4.0 if fine else 1.0,
        )
    return list(unique)


def _draw_mark(axes: Axes, mark: Mark, filled: dict[str, tuple[float, float]]) -> None:
    match mark:
        case Line() if not np.isfinite(mark.y).any():
            return
        case Line(dots=True):
            crowd = len(mark.x) > _CROWD
            axes.plot(
                mark.x, mark.y, ".", color=mark.colour, markersize=0.7 * mark.size, label=mark.name, rasterized=crowd
            )
        case Line():
            style = "steps-post" if mark.step else "default"
            axes.plot(mark.x, mark.y, _DASHES[mark.dash], color=mark.colour, lw=mark.width, label=mark.name, ds=style)
        case Band():
            axes.fill_between(mark.x, mark.low, mark.high, color=mark.colour, alpha=0.25, lw=0, label=mark.name)
        case Span():
            axes.axvspan(mark.start, mark.end, color=mark.colour, alpha=0.18, lw=0)
            middle = 0.5 * (mark.start + mark.end)
            axes.text(
                middle, 0.97, mark.name, transform=axes.get_xaxis_transform(), ha="center", va="top", fontsize=7.5
            )
        case Heat():
            z = np.ma.masked_invalid(mark.z.T)
            alpha = 1.0 if mark.sure is None else np.where(mark.sure, 1.0, 0.3).T
            extent = (*_edges(mark.x), *_edges(mark.y))
            image = axes.imshow(
                z, origin="lower", aspect="auto", extent=extent, cmap=mark.scale, vmin=mark.low, vmax=mark.high,
                alpha=alpha, interpolation="nearest",
            )  # fmt: skip
            axes.grid(False)
            axes.figure.colorbar(image, ax=axes, orientation="horizontal", label=mark.name, shrink=0.9)
        case Bars():
            ends = {category: filled.setdefault(category, (0.0, 0.0)) for category in mark.categories}
            left = [ends[c][int(v >= 0.0)] for c, v in zip(mark.categories, mark.values, strict=True)]
            axes.barh(mark.categories, mark.values, left=left, color=mark.colour, label=mark.name)
            for category, value in zip(mark.categories, mark.values, strict=True):
                below, above = ends[category]
                filled[category] = (below, above + value) if value >= 0.0 else (below + value, above)
            axes.yaxis.set_inverted(True)
        case Whiskers():
            arms = np.abs(np.nan_to_num(np.array([mark.values - mark.low, mark.high - mark.values])))
            place = np.arange(len(mark.categories))
            axes.errorbar(
                mark.values, place, xerr=arms, fmt="o", ms=4.5, capsize=3.0, color=mark.colour, label=mark.name
            )
            axes.set_yticks(range(len(mark.categories)), mark.categories)
            axes.set_ylim(len(mark.categories) - 0.5, -0.5)


def _edges(centres: np.ndarray) -> tuple[float, float]:
    half = 0.5 * (centres[1] - centres[0])
    return float(centres[0] - half), float(centres[-1] + half)
