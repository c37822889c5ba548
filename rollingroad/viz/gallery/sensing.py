"""Figures 2.2, 2.5, 2.6, 3.1, 3.2, 3.3, 4.7 and F.1: what the sensors see of the truth, and where it was driven."""

import numpy as np
import pymap3d

from observer.estimate import STATES
from observer.unscented import Spread, sigma_points
from rollingroad.run import Run
from rollingroad.viz import charts
from rollingroad.viz.charts import Chart, Line, Mark, Panel
from rollingroad.viz.views import sky_spans

_CLASSES = (0.0, 30.0, 50.0, 80.0, 110.0)
"""km/h: where the classes of figure F.1 begin."""
_HARD = 1.0
"""m/s2: from here figure 4.7 calls it accelerating hard."""


def sensing_charts(run: Run) -> list[Chart]:
    """The figures on sensors, in the thesis' order; those on altitude need GPS and road map in the log."""
    kinds = set(run.estimate.records["kind"].astype(str))
    heights = [_altitudes(run), _disagreement(run)] if {"gps_altitude", "map_altitude"} <= kinds else []
    made = [_gps_errors(run), *heights, _averaging(run), _quantized(run), _pulses(run)]
    return [*made, _accelerations(run), _speed_map(run)]


def _gps_errors(run: Run) -> Chart:
    """2.2: where the receiver says we are, about where we were."""
    gps = run.log["gps"]
    gps = gps[(gps["quality"] > 0) & np.isfinite(gps["latitude"])]
    trip = run.baseline
    east, north, _ = pymap3d.geodetic2enu(gps["latitude"], gps["longitude"], trip.origin[2], *trip.origin)
    time = gps["utc"] - trip.gps_epoch
    east_error = np.asarray(east) - np.interp(time, trip.time, trip.east)
    north_error = np.asarray(north) - np.interp(time, trip.time, trip.north)
    clear = gps["hdop"] < 2.0
    marks = tuple(
        Line(east_error[of], north_error[of], name, colour, dots=True)
        for of, name, colour in ((clear, "HDOP below 2", charts.BLUE), (~clear, "HDOP 2 and more", charts.VERMILION))
    )
    return Chart(
        "figure-2.2",
        "2.2 GPS errors",
        "Position of each fix minus the true position at the epoch that it names, east and north. Successive fixes err "
        "alike: the dots form threads, not a cloud.",
        (Panel("north (m)", marks, x_label="east (m)", equal=True),),
        height=480,
    )


def _altitudes(run: Run) -> Chart:
    """2.5: altitude of GPS and of the road map along the trajectory."""
    time, gps = _measured(run, "gps_altitude")
    map_time, road_map = _measured(run, "map_altitude")
    trip = run.baseline
    marks: tuple[Mark, ...] = (
        *sky_spans(run.route),
        Line(_place(run, time), gps, "GPS", charts.VERMILION),
        Line(_place(run, map_time), road_map, "road map", charts.GREEN, dots=True),
        Line(_place(run, trip.time[::50]), trip.altitude[::50], "true", charts.TRUTH, width=1.0),
    )
    return Chart(
        "figure-2.5",
        "2.5 Road map against GPS along a trajectory",
        "Altitude as the receiver gives it and as the road map's nodes have it.",
        (Panel("altitude (m)", marks, x_label="distance (km)"),),
    )


def _disagreement(run: Run) -> Chart:
    """2.6: GPS altitude minus the road map's, at the map's nodes."""
    time, gps = _measured(run, "gps_altitude")
    map_time, road_map = _measured(run, "map_altitude")
    difference = np.interp(map_time, time, gps) - road_map
    return Chart(
        "figure-2.6",
        "2.6 Disagreement between GPS and road map",
        "GPS altitude minus the road map's at its nodes.",
        (
            Panel(
                "difference (m)",
                (*sky_spans(run.route), Line(_place(run, map_time), difference, "GPS - road map", charts.VERMILION)),
                x_label="distance (km)",
            ),
        ),
        height=260,
    )


def _averaging(run: Run) -> Chart:
    """3.1: specific force at the sigma points of the pitch lies on a circle, their mean inside it."""
    g, wide = run.car.gravity, 0.6
    spread = Spread()

    def forces(deviation: float) -> charts.Array:
        pitch = sigma_points(np.zeros(1), np.array([[deviation]]), spread)[:, 0]
        return g * np.column_stack([np.sin(pitch), np.cos(pitch)])

    mean_weights = spread.weights(1)[0]
    points, mean = forces(wide), mean_weights @ forces(wide)
    arc = np.linspace(-1.2 * wide, 1.2 * wide, 121)
    variance = run.estimate.variance[:, STATES.index("pitch")]
    pitch_deviation = float(np.sqrt(np.nanmedian(variance)))
    error = g - float(mean_weights @ forces(pitch_deviation)[:, 1])
    dots = (
        (points[:, 0], points[:, 1], "sigma points", charts.BLUE),
        (np.zeros(1), np.array([g]), "at the mean pitch", charts.GREEN),
        (mean[:1], mean[1:], "mean of the sigma points", charts.VERMILION),
    )
    return Chart(
        "figure-3.1",
        "3.1 Sigma point averaging",
        f"Gravity in the car's axes over its pitch, with a deviation of {wide:g} rad to make it visible: the mean over "
        f"the sigma points lies {g - mean[1]:.2f} m/s² below what is measured at the mean pitch, and the filter would "
        f"correct a state that is right. With this run's own deviation of the pitch, {1e3 * pitch_deviation:.1f} mrad "
        f"(median), it is {1e6 * error:.0f} µm/s²: not what makes an unscented filter fail.",
        (
            Panel(
                "vertical specific force (m/s²)",
                (
                    Line(g * np.sin(arc), g * np.cos(arc), "over the pitch", charts.GREY),
                    *(Line(x, y, name, colour, dots=True, size=9.0) for x, y, name, colour in dots),
                ),
                x_label="longitudinal specific force (m/s²)",
                equal=True,
            ),
        ),
        height=420,
    )


def _quantized(run: Run) -> Chart:
    """3.2: the speed that single wheel pulses give, on their 125 us clock, over ten seconds."""
    time, speed = _pulse_speed(run)
    middle = float(time[len(time) // 2])
    inside = (time > middle) & (time < middle + 10.0)
    trip = run.baseline
    true = (trip.time > middle) & (trip.time < middle + 10.0)
    return Chart(
        "figure-3.2",
        "3.2 Quantized signal",
        "Metres per tick over the time between two ticks: the teeth's irregularity and the clock of 125 µs.",
        (
            Panel(
                "speed (km/h)",
                (
                    Line(time[inside], 3.6 * speed[inside], "single pulses", charts.ORANGE, width=0.8),
                    Line(trip.time[true][::5], 3.6 * trip.speed[true][::5], "true", charts.TRUTH),
                ),
                x_label="time (s)",
            ),
        ),
        height=300,
    )


def _pulses(run: Run) -> Chart:
    """3.3: the same over the whole trip."""
    time, speed = _pulse_speed(run)
    every = slice(None, None, max(len(time) // 4000, 1))
    dots = Line(time[every], 3.6 * speed[every], "pulses", charts.ORANGE, dots=True)
    return Chart(
        "figure-3.3",
        "3.3 Wheel speed signal",
        "Speed from single wheel pulses over the trip; silent below 3 to 4 km/h.",
        (Panel("speed (km/h)", (dots,), x_label="time (s)"),),
        height=300,
    )


def _speed_map(run: Run) -> Chart:
    """F.1: the track, coloured by speed."""
    trip = run.baseline
    rows = slice(None, None, max(len(trip.time) // 3000, 1))
    speed, east, north = 3.6 * trip.speed[rows], trip.east[rows] / 1e3, trip.north[rows] / 1e3
    ends = (*_CLASSES[1:], np.inf)
    colours = (charts.BLUE, charts.SKY_BLUE, charts.GREEN, charts.ORANGE, charts.VERMILION)
    marks = []
    for low, high, colour in zip(_CLASSES, ends, colours, strict=True):
        inside = (speed >= low) & (speed < high)
        name = f"{low:.0f} to {high:.0f} km/h" if np.isfinite(high) else f"above {low:.0f} km/h"
        marks.append(Line(east[inside], north[inside], name, colour, dots=True))
    return Chart(
        "figure-f.1",
        "F.1 The trip by speed",
        "As trip.kml shows it in a viewer of the globe.",
        (Panel("north (km)", tuple(marks), x_label="east (km)", equal=True),),
        height=420,
    )


def _accelerations(run: Run) -> Chart:
    """4.7: the thesis drove its acceleration test on one road; here, where on its road the run accelerated."""
    trip = run.baseline
    rows = slice(None, None, max(len(trip.time) // 6000, 1))
    east, north, hard = trip.east[rows] / 1e3, trip.north[rows] / 1e3, trip.acceleration[rows] > _HARD
    marks = (
        Line(east, north, "the road", charts.GREY),
        Line(east[hard], north[hard], f"accelerating by more than {_HARD:g} m/s²", charts.VERMILION, dots=True),
        Line(east[:1], north[:1], "start", charts.BLUE, dots=True, size=9.0),
    )
    return Chart(
        "figure-4.7",
        "4.7 Acceleration test route",
        "Where the baseline driver accelerates hard. The thesis tests 4.8 and 4.9 on 2 km of flat road; here these two "
        "are computed, and this is the road of the run.",
        (Panel("north (km)", marks, x_label="east (km)", equal=True),),
        height=420,
    )


def _measured(run: Run, kind: str) -> tuple[charts.Array, charts.Array]:
    records = run.estimate.records
    rows = records[(records["kind"] == kind) & np.isfinite(records["value"])]
    rows = rows[np.argsort(rows["t"], kind="stable")]
    return rows["t"], rows["value"]


def _place(run: Run, time: charts.Array) -> charts.Array:
    return np.interp(time, run.baseline.time, run.baseline.distance) / 1e3


def _pulse_speed(run: Run) -> tuple[charts.Array, charts.Array]:
    ticks = run.log["wheel"]["t"]
    gaps = np.diff(ticks)
    sound = (gaps > 1e-3) & (gaps < 0.4)
    return ticks[1:][sound], run.car.metres_per_tick / gaps[sound]
