"""The figures of the papers on bias augmentation and on engine map adaptation (Höckerdal, Frisk and Eriksson, 2009).

The engine is the benchmark diesel (Wahlström and Eriksson 2011), not the papers' Scania; the transient cycle is ours.
"""

import numpy as np

from rollingroad.diesel_studies import (
    ERROR,
    NODES,
    STEP,
    AugmentationStudy,
    MapStudy,
    map_study,
    map_study_wrong_compressor,
    shown,
    two_biases,
    wrong_engine,
)
from rollingroad.viz import charts
from rollingroad.viz.charts import Array, Band, Chart, Line, Panel

_SECONDS = 600.0
"""s of the transient cycle in the gallery: town, rural road, motorway, 200 s each."""
_EVERY = 40
"""Samples per point drawn."""
_OBSERVERS = {"Def.": charts.VERMILION, "Aug.": charts.BLUE, "Map.": charts.GREEN}
_STATES = (("intake (bar)", 1e-5), ("exhaust (bar)", 1e-5), ("turbine (krpm)", 30e-3 / np.pi))
_TOLD = {"Def.": "default", "Aug.": "augmented", "Map.": "with a map"}


def diesel_charts(seed: int = 0, seconds: float = _SECONDS) -> tuple[list[Chart], list[Chart]]:
    """The figures on bias augmentation (1 to 4) and on map adaptation (1 to 7); they need no run.

    `seconds` of a transient cycle are driven, and 600 s of held points for the design.
    """
    biases, engine = two_biases(seed, seconds), wrong_engine(seed, seconds)
    alone, wrong = map_study(seed, seconds), map_study_wrong_compressor(seed, seconds)
    own = "Two slow biases of the pressures; augmentation found on points held for 12 s"
    other = "An engine that the model does not know; its exhaust pressure is measured for the design only"
    augmentation = [
        _states("bias-1", f"1 States, {_named(biases)}", biases, f"{own}."),
        _errors("bias-2", "2 Estimation errors", biases, f"{own}."),
        _states(
            "bias-3", f"3 States, {_named(engine)}", engine, f"{other}. A simulated engine in place of the test cell."
        ),
        _errors("bias-4", "4 Estimation errors", engine, f"{other}. A simulated engine in place of the test cell."),
    ]
    return augmentation, [
        _error_map(),
        _variances(alone),
        _set_up(alone),
        _map_errors(alone),
        _corrections("adaptation-5", "5 The correction found", alone, "The air flow alone is measured."),
        _evolution(alone),
        _corrections(
            "adaptation-7",
            "7 The correction found on an engine with a wrong compressor",
            wrong,
            "Three sensors, and a bias of the compressor's flow beside the map. A simulated engine in place of the "
            "test cell: the true error is known.",
        ),
    ]


def _named(study: AugmentationStudy) -> str:
    order = study.augmentation.order
    return f"{order} bias{'es' if order > 1 else ''} found"


def _clock(rows: int) -> Array:
    return np.arange(rows).astype(np.float64) * STEP


def _middle(rows: int) -> slice:
    """The middle fifth, thinned: at full length two minutes of the rural part."""
    return slice(2 * rows // 5, 3 * rows // 5, 10)


def _states(key: str, title: str, study: AugmentationStudy, told: str) -> Chart:
    look = _middle(len(study.truth))
    time = _clock(len(study.truth))[look]
    panels = []
    for i, (label, scale) in enumerate(_STATES):
        lines = [Line(time, scale * study.truth[look, i], "true", charts.TRUTH)]
        lines += [
            Line(time, scale * found[look, i], _TOLD[name], _OBSERVERS[name], width=1.1)
            for name, found in study.found.items()
        ]
        panels.append(Panel(label, tuple(lines), x_label="time (s)" if i == 2 else ""))
    return Chart(key, title, told, tuple(panels), height=500)


def _errors(key: str, title: str, study: AugmentationStudy, told: str) -> Chart:
    time = _clock(len(study.truth))[::_EVERY]
    means = {
        name: np.abs((found - study.truth).mean(axis=0)) * [1.0, 1.0, 30 / np.pi] for name, found in study.found.items()
    }
    said = "; ".join(f"{_TOLD[name]} {m[0]:.0f} Pa, {m[1]:.0f} Pa, {m[2]:.0f} rpm" for name, m in means.items())
    units = (("intake (kPa)", 1e-3), ("exhaust (kPa)", 1e-3), ("turbine (krpm)", 30e-3 / np.pi))
    panels = tuple(
        Panel(
            label,
            tuple(
                Line(time, scale * (found - study.truth)[::_EVERY, i], _TOLD[name], _OBSERVERS[name], width=0.9)
                for name, found in study.found.items()
            ),
            x_label="time (s)" if i == 2 else "",
        )
        for i, (label, scale) in enumerate(units)
    )
    return Chart(key, title, f"{told} Mean errors over the cycle: {said}.", panels, height=500)


def _error_map() -> Chart:
    return Chart(
        "adaptation-1",
        "1 Air mass-flow correction map",
        "The relative error of the air-flow sensor, linear between twelve nodes. Only the two nodes around an "
        "operating point are observable there. The published map's values are not printed; this one is ours.",
        (
            Panel(
                "correction (%)",
                (
                    Line(NODES, 100 * ERROR, "between nodes", charts.BLACK),
                    Line(NODES, 100 * ERROR, "nodes", charts.VERMILION, dots=True, size=8.0),
                ),
                x_label="air flow (kg/s)",
            ),
        ),
        height=300,
    )


def _variances(study: MapStudy) -> Chart:
    """Of the nodes most and least visited, and of one between."""
    estimate = study.estimates["Map."]
    order = np.argsort(study.visits)
    chosen = (int(order[-1]), int(order[len(order) // 2]), int(order[0]))
    variance = estimate.variance[::_EVERY, -len(NODES) :]
    time = _clock(len(estimate.variance))[::_EVERY]
    lines = tuple(
        Line(time, 100 * np.sqrt(variance[:, j]), f"{NODES[j]:.2f} kg/s, {study.visits[j]:.0f} s there", colour)
        for j, colour in zip(chosen, (charts.GREEN, charts.BLUE, charts.VERMILION), strict=True)
    )
    return Chart(
        "adaptation-2",
        "2 Certainty of three nodes",
        "Standard deviation of the correction at a node: it falls while the engine runs near it, and grows again, "
        "slowly and up to a limit, while it does not.",
        (Panel("deviation (%)", lines, x_label="time (s)"),),
        height=320,
    )


def _set_up(study: MapStudy) -> Chart:
    """3: the paper draws a block diagram; here what flows through it."""
    look = _middle(len(study.air))
    time = _clock(len(study.air))[look]
    lines = (
        Line(time, study.sensor[look], "sensor: what the observers get", charts.ORANGE, width=0.9),
        Line(time, study.air[look], "true", charts.TRUTH),
    )
    return Chart(
        "adaptation-3",
        "3 Simulation set-up: the air flow before and after the sensor's error",
        "The engine's air flow, distorted by the map of figure 1 and by noise, is all that the observers see.",
        (Panel("air flow (kg/s)", lines, x_label="time (s)"),),
        height=320,
    )


def _map_errors(study: MapStudy) -> Chart:
    time = _clock(len(study.air))[::_EVERY]
    found = {name: shown(estimate, study.run)[::_EVERY] for name, estimate in study.estimates.items()}
    labels = (("intake (kPa)", 1e-3), ("exhaust (kPa)", 1e-3), ("turbine (krpm)", 1e-3), ("air (g/s)", 1e3))
    panels = tuple(
        Panel(
            label,
            tuple(Line(time, scale * e[:, i], _TOLD[name], _OBSERVERS[name], width=0.9) for name, e in found.items()),
            x_label="time (s)" if i == 3 else "",
        )
        for i, (label, scale) in enumerate(labels)
    )
    return Chart(
        "adaptation-4",
        "4 Estimation errors",
        "Without knowledge of the sensor's error, with one bias for it, and with a map.",
        panels,
        height=620,
    )


def _corrections(key: str, title: str, study: MapStudy, told: str) -> Chart:
    """The map at the end, and the bias over air flow; nodes never visited are left out."""
    visited = study.visits > 5.0
    node, bias = study.estimates["Map."], study.estimates["Aug."]
    rows = slice(len(study.air) // 30, None, 60)
    flow = bias.air_flow[rows]
    nodes, deviation = node.nodes[-1], np.sqrt(node.variance[-1, -len(NODES) :])
    off = float(np.abs(nodes - ERROR)[visited].max())
    marks = (
        Line(flow, 100 * bias.bias[rows, 0] / flow, "one bias, over the air flow", charts.BLUE, dots=True, size=2.0),
        Band(NODES[visited], 100 * (nodes - 2 * deviation)[visited], 100 * (nodes + 2 * deviation)[visited],
             "map ± 2 sd", charts.GREEN),
        Line(NODES[visited], 100 * nodes[visited], "map found", charts.GREEN, width=2.2),
        Line(NODES, 100 * ERROR, "true", charts.TRUTH, dash="dash"),
    )  # fmt: skip
    return Chart(
        key,
        title,
        f"{told} After {len(study.air) * STEP:.0f} s the worst of the {int(visited.sum())} nodes visited for more than "
        f"5 s is off by {100 * off:.2f} percentage points.",
        (Panel("correction (%)", marks, x_label="air flow (kg/s)", y_range=(-12.0, 12.0)),),
        height=380,
    )


def _evolution(study: MapStudy) -> Chart:
    nodes = study.estimates["Map."].nodes
    colours = (charts.GREY, charts.SKY_BLUE, charts.BLUE, charts.ORANGE, charts.VERMILION)
    moments = (0.0, *(share * len(nodes) * STEP for share in (0.02, 0.1, 0.4)), (len(nodes) - 1) * STEP)
    lines = [
        Line(NODES, 100 * nodes[round(moment / STEP)], f"{moment:.0f} s", colour)
        for moment, colour in zip(moments, colours, strict=True)
    ]
    return Chart(
        "adaptation-6",
        "6 Evolution of the map",
        "Nothing is known at first; the nodes settle as the operating region is covered.",
        (
            Panel(
                "correction (%)",
                (*lines, Line(NODES, 100 * ERROR, "true", charts.TRUTH, dash="dash")),
                x_label="air flow (kg/s)",
            ),
        ),
        height=360,
    )
