"""A `Chart` as the JSON that plotly.js draws: for readers with scripts."""

import base64
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from rollingroad.viz.charts import Band, Bars, Chart, Heat, Line, Mark, Panel, Span, Whiskers

_GRID = {"gridcolor": "#dddddd", "zeroline": False, "automargin": True}


def plotly_figure(chart: Chart) -> dict[str, Any]:
    """Return `{"data": [...], "layout": {...}}` of plotly.js; arrays as base64 of 32-bit floats."""
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "height": chart.height,
        "margin": {"l": 52, "r": 8, "t": 26, "b": 40},
        "font": {"family": "system-ui, sans-serif", "size": 12},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0, "traceorder": "normal"},
        "modebar": {"bgcolor": "rgba(255,255,255,0.8)", "color": "#767676", "activecolor": "#1a1a1a"},
        "hovermode": "closest" if chart.beside else "x unified",
        "dragmode": "zoom",
        "barmode": "relative",
        "shapes": [],
        "annotations": [],
    }
    for number, (panel, place) in enumerate(zip(chart.panels, _places(chart), strict=True), start=1):
        suffix = "" if number == 1 else str(number)
        layout |= _axes(panel, place, suffix, number, chart)
        if panel.title:
            layout["annotations"].append(_heading(panel.title, suffix))
        seen = {trace["name"] for trace in data if "name" in trace}
        named = sum(isinstance(mark, Line | Band | Bars | Whiskers) for mark in panel.marks) > 1
        for mark in panel.marks:
            if isinstance(mark, Span):
                layout["shapes"].append(_shape(mark, suffix))
                layout["annotations"].append(_word(mark, suffix))
                continue
            for trace in _traces(mark, place):
                trace |= {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
                if "name" in trace:
                    trace["showlegend"] = named and trace["name"] not in seen
                    seen.add(trace["name"])
                data.append(trace)
    return {"data": data, "layout": layout}


def _places(chart: Chart) -> list[tuple[float, float]]:
    """Each panel's share of the width (panels beside one another) or of the height (from the top down)."""
    gap = 0.09 if chart.beside else 0.06
    weights = np.array([1.0 if chart.beside else panel.weight for panel in chart.panels])
    sizes = weights / weights.sum() * (1.0 - gap * (len(weights) - 1))
    starts = np.concatenate([[0.0], np.cumsum(sizes[:-1] + gap)])
    if chart.beside:
        return [(float(a), float(a + size)) for a, size in zip(starts, sizes, strict=True)]
    return [(max(float(1.0 - a - size), 0.0), float(1.0 - a)) for a, size in zip(starts, sizes, strict=True)]


def _axes(panel: Panel, place: tuple[float, float], suffix: str, number: int, chart: Chart) -> dict[str, Any]:
    x: dict[str, Any] = {**_GRID, "title": {"text": panel.x_label}, "anchor": f"y{suffix}"}
    y: dict[str, Any] = {**_GRID, "title": {"text": panel.y_label}, "anchor": f"x{suffix}"}
    (x if chart.beside else y)["domain"] = place
    if not chart.beside and number > 1:
        x["matches"] = "x"
    if not chart.beside and number < len(chart.panels):
        x["showticklabels"] = False
    if panel.equal:
        y["scaleanchor"] = f"x{suffix}"
    if panel.y_range:
        y["range"] = panel.y_range
    if panel.log_x:
        x["type"] = "log"
    if panel.x_range:
        x["range"] = tuple(np.log10(panel.x_range)) if panel.log_x else panel.x_range
    rows = next((mark.categories for mark in panel.marks if isinstance(mark, Bars | Whiskers)), None)
    if rows is not None:
        y |= {
            "type": "category",
            "categoryarray": list(rows),
            "autorange": "reversed",
            "title": {"text": ""},
            "showticklabels": number == 1,
        }
    axes: dict[str, Any] = {f"xaxis{suffix}": x, f"yaxis{suffix}": y}
    return axes


def _traces(mark: Mark, place: tuple[float, float]) -> list[dict[str, Any]]:
    match mark:
        case Line():
            style = {"color": mark.colour, "width": mark.width, "dash": mark.dash or "solid"}
            style["shape"] = "hv" if mark.step else "linear"
            trace = {"type": "scatter", "x": _packed(mark.x), "y": _packed(mark.y), "name": mark.name, "line": style}
            trace["mode"] = "markers" if mark.dots else "lines"
            if mark.dots:
                trace["marker"] = {"color": mark.colour, "size": mark.size}
            return [trace]
        case Band():
            x = np.concatenate([mark.x, mark.x[::-1]])
            y = np.concatenate([mark.high, mark.low[::-1]])
            area = {
                "type": "scatter",
                "x": _packed(x),
                "y": _packed(y),
                "fill": "toself",
                "fillcolor": _faint(mark.colour),
            }
            return [{**area, "line": {"width": 0}, "name": mark.name, "hoverinfo": "skip", "mode": "lines"}]
        case Heat():
            sure = np.isfinite(mark.z) if mark.sure is None else mark.sure
            common = {
                "type": "heatmap", "x": _packed(mark.x), "y": _packed(mark.y), "zmin": mark.low, "zmax": mark.high,
                "colorscale": _stops(mark.scale), "hoverongaps": False,
                "hovertemplate": f"%{{x:.4g}} {mark.units[0]}, %{{y:.4g}} {mark.units[1]}<br>{mark.name} %{{z:.2f}}"
                "<extra></extra>",
            }  # fmt: skip
            bar = {"orientation": "h", "title": {"text": mark.name, "side": "bottom"}, "thickness": 10, "y": -0.30}
            bar |= {"x": 0.5 * (place[0] + place[1]), "len": place[1] - place[0], "yanchor": "top"}
            faint = {**common, "z": _packed(np.where(sure, np.nan, mark.z).T), "opacity": 0.3, "showscale": False}
            return [faint, {**common, "z": _packed(np.where(sure, mark.z, np.nan).T), "colorbar": bar}]
        case Bars():
            bar = {"type": "bar", "orientation": "h", "y": list(mark.categories), "x": [float(v) for v in mark.values]}
            return [{**bar, "name": mark.name, "marker": {"color": mark.colour}}]
        case Whiskers():
            finite = np.isfinite(mark.values)
            values, names = mark.values[finite], [c for c, f in zip(mark.categories, finite, strict=True) if f]
            arms = {
                "type": "data",
                "array": np.nan_to_num(mark.high[finite] - values).tolist(),
                "arrayminus": np.nan_to_num(values - mark.low[finite]).tolist(),
            }
            point = {"type": "scatter", "mode": "markers", "x": values.tolist(), "y": names, "name": mark.name}
            return [{**point, "error_x": arms, "marker": {"color": mark.colour, "size": 8}}]
        case Span():
            return []


def _shape(span: Span, suffix: str) -> dict[str, Any]:
    place = {"type": "rect", "xref": f"x{suffix}", "yref": f"y{suffix} domain", "x0": span.start, "x1": span.end}
    return {
        **place,
        "y0": 0,
        "y1": 1,
        "fillcolor": span.colour,
        "opacity": 0.18,
        "line": {"width": 0},
        "layer": "below",
    }


def _word(span: Span, suffix: str) -> dict[str, Any]:
    place = {"xref": f"x{suffix}", "yref": f"y{suffix} domain", "x": 0.5 * (span.start + span.end), "y": 1.0}
    return {**place, "text": span.name, "showarrow": False, "yanchor": "top", "font": {"size": 10}}


def _stops(scale: str) -> list[tuple[float, str]]:
    """matplotlib's colour map of that name, so that both drawings agree."""
    places = np.linspace(0.0, 1.0, 17)
    return [(float(place), to_hex(colormaps[scale](place))) for place in places]


def _heading(text: str, suffix: str) -> dict[str, Any]:
    place = {"xref": f"x{suffix} domain", "yref": f"y{suffix} domain", "x": 0, "y": 1, "xanchor": "left"}
    return {**place, "text": f"<b>{text}</b>", "showarrow": False, "yanchor": "bottom"}


def _faint(colour: str) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.25)"


def _packed(values: np.ndarray) -> dict[str, Any]:
    """plotly.js' typed arrays: about a third of the size of decimal text."""
    flat = np.ascontiguousarray(values, dtype="<f4")
    packed: dict[str, Any] = {"dtype": "f4", "bdata": base64.b64encode(flat.tobytes()).decode()}
    return packed | {"shape": ", ".join(map(str, flat.shape))} if flat.ndim > 1 else packed
