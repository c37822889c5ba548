"""Figures 9 to 16 of the paper on H2 sensor selection: the burnt gas in the intake, found with sets of sensors."""

import numpy as np

from rollingroad.engine_sensors import SETTLED, Study, study
from rollingroad.viz import charts
from rollingroad.viz.charts import Chart, Line, Panel

_COLOURS = (charts.BLUE, charts.VERMILION, charts.GREEN, charts.ORANGE, charts.PURPLE, charts.SKY_BLUE)
_ENGINE = "A mean-value engine with low-pressure EGR of our own, not the paper's: orderings compare, digits do not."


def selection_charts() -> list[Chart]:
    """The eight figures, in order; they need no run."""
    found = study()
    of_size = [[i for i, chosen in enumerate(found.sets) if len(chosen) == size] for size in range(5)]
    optimal = [min(rows, key=lambda i: found.expected[i]) for rows in of_size]
    single, pairs = [*of_size[0], *of_size[1]], of_size[2]
    return [
        _tracks("9", "One sensor", found, single, zoom=True),
        _histograms("10", "One sensor: errors", found, of_size[1]),
        _tracks("11", "Two sensors", found, pairs),
        _against_expected(found, pairs),
        _histograms("13", "Two sensors: errors", found, pairs),
        _tracks("14", "The sets chosen, by number of sensors", found, optimal[1:]),
        _by_number(found, optimal),
        _histograms("16", "The sets chosen: errors", found, optimal),
    ]


def _name(found: Study, row: int) -> str:
    return " + ".join(found.sets[row]) or "none"


def _lines(found: Study, rows: list[int], where: slice) -> tuple[Line, ...]:
    colours = _COLOURS if len(rows) <= len(_COLOURS) else (*_COLOURS, charts.GREY)
    drawn = [
        Line(found.time[where], found.found[row, where], _name(found, row), colour, width=1.1)
        for row, colour in zip(rows, colours, strict=False)
    ]
    return (Line(found.time[where], found.truth[where], "true", charts.TRUTH, width=1.8), *drawn)


def _tracks(number: str, title: str, found: Study, rows: list[int], *, zoom: bool = False) -> Chart:
    step = found.time[1] - found.time[0]
    whole = slice(round(SETTLED / step), None, 4)
    panels = [Panel("burnt gas (%)", _lines(found, rows, whole), x_label="time (s)")]
    if zoom:
        # the half second in which the truth moves most
        length = round(0.5 / step)
        change = np.abs(found.truth[length:] - found.truth[:-length])
        start = round(SETTLED / step) + int(np.argmax(change[round(SETTLED / step) :]))
        inside = slice(start, start + length)
        panels.append(Panel("burnt gas (%)", _lines(found, rows, inside), "fastest half second", "time (s)"))
    told = "; ".join(f"{_name(found, row)} {found.simulated[row]:.3f}" for row in rows)
    return Chart(
        f"selection-{number}",
        f"{number} {title}",
        f"Burnt gas in the intake, found by linear observers of a nonlinear engine. {_ENGINE} RMSE after "
        f"{SETTLED:g} s, %: {told}.",
        tuple(panels),
        beside=zoom,
        height=420,
    )


def _histograms(number: str, title: str, found: Study, rows: list[int]) -> Chart:
    use = found.time >= SETTLED
    errors = [found.found[row, use] - found.truth[use] for row in rows]
    reach = max(float(np.abs(error).max()) for error in errors)
    edges = np.linspace(-reach, reach, 61)
    lines = []
    for row, error, colour in zip(rows, errors, _COLOURS, strict=False):
        share = 100.0 * np.histogram(error, edges)[0] / len(error)
        lines.append(Line(edges, np.append(share, 0.0), _name(found, row), colour, step=True))
    return Chart(
        f"selection-{number}",
        f"{number} {title}",
        "Distribution of the error over the cycle, share of the samples in each bin.",
        (Panel("samples (%)", tuple(lines), x_label="error (% burnt gas)"),),
        height=340,
    )


def _against_expected(found: Study, pairs: list[int]) -> Chart:
    dots = tuple(
        Line(found.expected[[row]], found.simulated[[row]], _name(found, row), colour, dots=True, size=10.0)
        for row, colour in zip(pairs, _COLOURS, strict=True)
    )
    rank = np.corrcoef(found.expected[pairs].argsort().argsort(), found.simulated[pairs].argsort().argsort())[0, 1]
    return Chart(
        "selection-12",
        "12 Expected and simulated error of two sensors",
        "Expected: the H2 norm, which is the root of the paper's trace(T). In the paper the simulated error grows with "
        f"it; on this engine the rank correlation is {rank:+.2f}, because the sensor that the linear model values most "
        "is the one that it misreads most away from the operating point (docs, Sensor selection).",
        (Panel("simulated RMSE (%)", dots, x_label="expected RMSE (%)"),),
        height=380,
    )


def _by_number(found: Study, optimal: list[int]) -> Chart:
    count = np.arange(len(optimal), dtype=float)
    lines = (
        Line(count, found.expected[optimal], "expected", charts.BLUE),
        Line(count, found.simulated[optimal], "simulated", charts.VERMILION),
    )
    told = ", ".join(f"{_name(found, row)}" for row in optimal[1:])
    return Chart(
        "selection-15",
        "15 Error over the number of sensors",
        f"The sets chosen: {told}. Expected: the second sensor helps, the third and fourth add next to nothing.",
        (Panel("RMSE (% burnt gas)", lines, x_label="sensors"),),
        height=340,
    )
