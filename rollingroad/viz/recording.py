"""run.rrd: every signal of a run for rerun's viewer, written by columns after the run, with a blueprint made for it."""

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pymap3d
import rerun as rr
from matplotlib import colormaps
from numpy.typing import NDArray

from observer.efficiency_map import EfficiencyMap
from observer.estimate import STATES
from rollingroad.run import Run
from rollingroad.viz import charts
from rollingroad.viz.blueprint import blueprint
from rollingroad.viz.views import gear_name
from vehicle_model.car.errors import BadInput
from vehicle_model.car.route import CANYON, TUNNEL
from vehicle_model.car.trip import Trip

Array = NDArray[np.float64]
_KMH, _RPM = 3.6, 30.0 / np.pi
_RATE = 10.0
"""Hz, of what is drawn from a trip."""
_CLUTCH = {"locked": charts.GREY, "slipping": charts.YELLOW, "open": charts.SKY_BLUE}
_SKY = {"open": charts.GREEN, "canyon": charts.ORANGE, "tunnel": charts.BLACK}
_GPS = {"fixes": charts.GREEN, "outage": charts.VERMILION}


def write_recording(run: Run, path: Path) -> None:
    """Write `run` as a rerun recording with its blueprint, aside and renamed.

    Two timelines: `time` (s of the drive) and `distance` (m along the road), so that baseline and advised drives
    can be compared at the same moment as well as at the same place.
    """
    aside = path.with_name(path.name + ".part")
    name = f"{run.results['scenario']}, {run.results['car']}, seed {run.results['seed']}"
    recording = rr.RecordingStream("rollingroad", recording_id=name)
    recording.save(aside, default_blueprint=blueprint())
    writer = _Writer(recording)
    _write_drive(writer, "baseline", charts.BASELINE, run.baseline)
    _write_drive(writer, "advised", charts.ADVISED, run.advised)
    _write_road(writer, run)
    _write_advice(writer, run)
    _write_estimate(writer, run)
    _write_records(writer, run)
    _write_gps(writer, run)
    _write_engine_map(writer, run.efficiency_map, run.baseline)
    recording.flush()
    recording.disconnect()
    aside.replace(path)


def view(folder: Path, over: str = "time") -> int:
    """Open the recording of the run in `folder` in rerun's viewer, over "time" or "distance"; return its exit status.

    Raises BadInput where the folder holds none.
    """
    path = folder / "run.rrd"
    if not path.is_file():
        raise BadInput(folder, "run.rrd", "expected a run folder that holds a recording")
    with tempfile.TemporaryDirectory(prefix="rollingroad-") as scratch:
        layout = Path(scratch) / "layout.rbl"
        blueprint(over).save("rollingroad", str(layout))
        return subprocess.run([sys.executable, "-m", "rerun", str(path), str(layout)], check=False).returncode


@dataclass(frozen=True)
class _Clock:
    """When and, where known, at which place along the road the rows of a signal stand."""

    time: Array
    distance: Array | None = None

    def where(self, mask: NDArray[np.bool_]) -> "_Clock":
        return _Clock(self.time[mask], None if self.distance is None else self.distance[mask])


class _Writer:
    """Sends columns on both timelines to one recording."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self.recording = recording

    def columns(self, entity: str, clock: _Clock, columns: object) -> None:
        indexes = [rr.TimeColumn("time", duration=clock.time)]
        if clock.distance is not None:
            indexes.append(rr.TimeColumn("distance", sequence=np.round(clock.distance).astype(np.int64)))
        rr.send_columns(entity, indexes, columns, recording=self.recording)  # pyright: ignore[reportArgumentType]

    def series(self, entity: str, clock: _Clock, values: Array, colour: str, name: str, form: str = "line") -> None:
        """The finite values as a "line", as "steps" that hold their value, or as "dots"."""
        finite = np.isfinite(values)
        self.columns(entity, clock.where(finite), rr.Scalars.columns(scalars=values[finite]))
        rgb = _rgb(colour)
        if form == "dots":
            self.static(entity, rr.SeriesPoints(colors=rgb, names=name, markers="Circle", marker_sizes=1.5))
        else:
            mode = "StepAfter" if form == "steps" else "Linear"
            self.static(entity, rr.SeriesLines(colors=rgb, names=name, widths=1.5, interpolation_mode=mode))

    def states(self, entity: str, clock: _Clock, labels: NDArray[np.str_], colours: dict[str, str]) -> None:
        """A lane of the state timeline: only the changes are written. `colours` by label."""
        changes = np.concatenate([[True], labels[1:] != labels[:-1]])
        self.columns(entity, clock.where(changes), rr.StateChange.columns(state=labels[changes].tolist()))
        names = list(colours)
        self.static(entity, rr.StateConfiguration(values=names, labels=names, colors=[_rgb(colours[n]) for n in names]))

    def static(self, entity: str, what: rr.AsComponents) -> None:
        self.recording.log(entity, what, static=True)


def _write_drive(out: _Writer, name: str, colour: str, trip: Trip) -> None:
    rows = slice(None, None, max(round(1.0 / _RATE / trip.step), 1))
    c = {channel: values[rows] for channel, values in trip.channels.items()}
    clock = _Clock(c["time"], c["distance"])
    for entity, values in {
        f"speed/{name}": c["speed"] * _KMH,
        f"gear/{name}": c["gear"],
        f"engine/speed/{name}": c["engine_speed"] * _RPM,
        f"engine/torque/{name}": c["engine_torque"],
        f"fuel/power/{name}": c["fuel_power"] / 1e3,
        f"fuel/burnt/{name}": c["fuel_energy"] / 1e6,
        f"force/brake/{name}": c["brake_force"] / 1e3,
        f"force/road_load/{name}": c["road_load"] / 1e3,
        f"driver/pedal/{name}": 100.0 * c["throttle"],
    }.items():
        out.series(entity, clock, values, colour, name, "steps" if entity.startswith("gear") else "line")
    out.columns(f"plan/car/{name}", clock, rr.Points2D.columns(positions=_plan(c["east"], c["north"])))
    out.static(f"plan/car/{name}", rr.Points2D.from_fields(colors=[_rgb(colour)], radii=rr.Radius.ui_points([6.0])))
    latitude, longitude, _ = pymap3d.enu2geodetic(c["east"], c["north"], 0 * clock.time, *trip.origin)
    out.columns(f"map/car/{name}", clock, rr.GeoPoints.columns(positions=np.column_stack([latitude, longitude])))
    out.static(f"map/car/{name}", rr.GeoPoints.from_fields(colors=[_rgb(colour)], radii=rr.Radius.ui_points([6.0])))
    clutch = np.where(c["clutch"] >= 0.999, "locked", np.where(c["clutch"] <= 0.001, "open", "slipping"))
    out.states(f"state/clutch/{name}", clock, clutch, _CLUTCH)


def _write_road(out: _Writer, run: Run) -> None:
    trip, route = run.baseline, run.route
    rows = slice(None, None, max(round(0.5 / trip.step), 1))
    clock = _Clock(trip.time[rows], trip.distance[rows])
    out.series("speed/limit", clock, trip.speed_limit[rows] * _KMH, charts.LIMIT, "limit", "steps")
    out.series("road/altitude", clock, trip.altitude[rows], charts.TRUTH, "altitude")
    out.series("road/grade", clock, 100 * np.tan(trip.pitch[rows]), charts.TRUTH, "grade")
    sky = np.select([trip.sky[rows] == TUNNEL, trip.sky[rows] == CANYON], ["tunnel", "canyon"], "open")
    out.states("faults/sky", clock, sky, _SKY)
    out.static("plan/road", rr.LineStrips2D([_plan(route.east, route.north)], colors=[_rgb(charts.GREY)], radii=[1.5]))
    latitude, longitude, _ = pymap3d.enu2geodetic(route.east, route.north, 0 * route.s, *route.origin)
    line = np.column_stack([latitude, longitude])
    out.static(
        "map/road", rr.GeoLineStrings(lat_lon=[line], colors=[_rgb(charts.GREY)], radii=rr.Radius.ui_points([2.0]))
    )


def _write_advice(out: _Writer, run: Run) -> None:
    advice = run.advice
    clock = _Clock(np.interp(advice.s, run.advised.distance, run.advised.time), advice.s)  # where the driver met it
    out.series("speed/advice", clock, advice.speed * _KMH, charts.ADVICE, "advice")
    out.series("gear/advice", clock, advice.gear.astype(float), charts.ADVICE, gear_name(run), "steps")
    out.series("engine/torque/advice", clock, advice.torque, charts.ADVICE, "advice")
    out.series("advice/costate", clock, advice.costate / 1e3, charts.ADVICE, "worth of speed (kJ per m/s)")
    out.series("fuel/burnt/predicted", clock, advice.fuel / 1e6, charts.ADVICE, "predicted")


def _write_estimate(out: _Writer, run: Run) -> None:
    e, trip = run.estimate, run.baseline
    clock = _Clock(e.time, e.column("distance", smoothed=True))
    deviation = {name: np.sqrt(e.variance[:, i]) for i, name in enumerate(STATES)}
    for name, scale in {
        "thrust": 1e-3,
        "speed": _KMH,
        "pitch": 100.0,
        "fuel_power": 1e-3,
        "engine_speed": _RPM,
    }.items():
        filtered = scale * e.column(name)
        out.series(f"observer/{name}/filter", clock, filtered, charts.FILTER, "filter")
        out.series(
            f"observer/{name}/low", clock, filtered - 2 * scale * deviation[name], charts.SKY_BLUE, "filter - 2 sd"
        )
        out.series(
            f"observer/{name}/high", clock, filtered + 2 * scale * deviation[name], charts.SKY_BLUE, "filter + 2 sd"
        )
        out.series(f"observer/{name}/smoothed", clock, scale * e.column(name, smoothed=True), charts.FOUND, "smoothed")
    for axis in "xyz":
        colour = dict(zip("xyz", (charts.BLUE, charts.VERMILION, charts.GREEN), strict=True))[axis]
        out.series(f"observer/bias/{axis}", clock, e.column(f"bias_{axis}"), colour, f"bias {axis}")
    truth = {
        "thrust": (trip.thrust - trip.brake_force) / 1e3,
        "speed": trip.speed * _KMH,
        "pitch": 100.0 * trip.pitch,
        "fuel_power": trip.fuel_power / 1e3,
        "engine_speed": trip.engine_speed * _RPM,
    }
    rows = slice(None, None, max(round(0.5 / _RATE / trip.step), 1))
    true_clock = _Clock(trip.time[rows], trip.distance[rows])
    for name, values in truth.items():
        out.series(f"observer/{name}/true", true_clock, values[rows], charts.TRUTH, "true")
    every = np.arange(len(e.time)) % 5 == 0
    centres = _plan(e.column("east"), e.column("north"))[every]
    sizes = 2.0 * np.column_stack([deviation["east"], deviation["north"]])[every]
    out.columns("plan/estimate", clock.where(every), rr.Ellipses2D.columns(centers=centres, half_sizes=sizes))
    out.static("plan/estimate", rr.Ellipses2D.from_fields(colors=[_rgb(charts.FOUND)]))
    out.static("plan/track", rr.LineStrips2D([centres], colors=[_rgb(charts.FOUND)], radii=[0.7]))


def _write_records(out: _Writer, run: Run) -> None:
    records = run.estimate.records
    kinds = records["kind"].astype(str)
    for kind in sorted(set(kinds)):
        rows = records[kinds == kind]
        rows = rows[np.argsort(rows["t"], kind="stable")]
        normalised = rows["innovation"] / np.sqrt(rows["variance"])
        fused = rows["fused"].astype(bool)
        clock = _estimated(run, rows["t"])
        out.series(f"innovation/{kind}", clock.where(fused), normalised[fused], charts.BLUE, kind, "dots")
        if not fused.all():
            out.series(f"rejected/{kind}", clock.where(~fused), normalised[~fused], charts.VERMILION, kind, "dots")


def _write_gps(out: _Writer, run: Run) -> None:
    gps = run.log["gps"]
    gps = gps[(gps["quality"] > 0) & np.isfinite(gps["latitude"]) & np.isfinite(gps["altitude"])]
    if len(gps) == 0:
        return
    east, north, _ = pymap3d.geodetic2enu(gps["latitude"], gps["longitude"], gps["altitude"], *run.baseline.origin)
    colours = (255 * colormaps["cividis"](np.clip((gps["hdop"] - 0.8) / 4.0, 0.0, 1.0))).astype(np.uint8)
    positions = _plan(np.asarray(east), np.asarray(north))
    out.static(
        "plan/gps/fixes", rr.Points2D(positions, colors=colours, radii=rr.Radius.ui_points([2.0]), draw_order=-1.0)
    )
    geo = np.column_stack([gps["latitude"], gps["longitude"]])
    out.static("map/gps/fixes", rr.GeoPoints(lat_lon=geo, colors=colours, radii=rr.Radius.ui_points([2.0])))
    t = np.maximum.accumulate(gps["t"])
    clock = _estimated(run, t)
    out.columns("plan/gps/now", clock, rr.Points2D.columns(positions=positions))
    out.static("plan/gps/now", rr.Points2D.from_fields(colors=[_rgb(charts.PURPLE)], radii=rr.Radius.ui_points([4.0])))
    out.series("gps/hdop", clock, gps["hdop"], charts.PURPLE, "HDOP (1)")
    out.series("gps/altitude", clock, gps["altitude"], charts.PURPLE, "GPS")
    starts, ends = _gaps(t)
    times = np.concatenate([t[:1], starts, ends])
    labels = np.array(["fixes"] + ["outage"] * len(starts) + ["fixes"] * len(ends))
    order = np.argsort(times, kind="stable")
    out.states("faults/gps", _estimated(run, times[order]), labels[order], _GPS)


def _estimated(run: Run, time: Array) -> _Clock:
    """`time` (n,) of the logger, and where the observer holds that to have been."""
    return _Clock(time, np.interp(time, run.estimate.time, run.estimate.column("distance", smoothed=True)))


def _gaps(time: Array, longest: float = 1.0) -> tuple[Array, Array]:
    """Starts and ends of the stretches longer than `longest` seconds without a fix."""
    gaps = np.flatnonzero(np.diff(time) > longest)
    return time[gaps], time[gaps + 1]


def _write_engine_map(out: _Writer, found: EfficiencyMap, trip: Trip) -> None:
    """The visited part of the map as an image, one pixel per cell, and the engine's place on it: x right, y down."""
    columns, rows = _used(np.any(found.count > 0, axis=1)), _used(np.any(found.count > 0, axis=0))
    mean, valid = found.mean[columns, rows], found.valid[columns, rows]
    picture = colormaps["cividis"](np.clip(np.nan_to_num(mean) / 0.4, 0.0, 1.0))
    picture[~np.isfinite(mean)] = (0.93, 0.93, 0.93, 1.0)
    doubtful = np.isfinite(mean) & ~valid
    picture[doubtful] = 0.5 * picture[doubtful] + 0.5
    image = (255 * picture[:, :, :3]).astype(np.uint8).transpose(1, 0, 2)[::-1]
    out.static("engine_map/found", rr.Image(np.ascontiguousarray(image)))

    engine_speed, torque = found.engine_speed[columns], found.torque[rows]

    def cells(omega: Array, load: Array) -> Array:
        x = (omega - engine_speed[0]) / (found.engine_speed[1] - found.engine_speed[0]) + 0.5
        y = len(torque) - 0.5 - (load - torque[0]) / (found.torque[1] - found.torque[0])
        return np.column_stack([x, y])

    every = slice(None, None, max(round(1.0 / _RATE / trip.step), 1))
    omega = trip.engine_speed[every]
    load = np.maximum(trip.thrust[every] * trip.speed[every] / np.maximum(omega, 1.0), 0.0)
    now = rr.Points2D.columns(positions=cells(omega, load))
    out.columns("engine_map/now", _Clock(trip.time[every], trip.distance[every]), now)
    out.static("engine_map/now", rr.Points2D.from_fields(colors=[_rgb(charts.VERMILION)], radii=[0.8]))
    rpm = np.arange(1000.0, engine_speed[-1] * _RPM, 1000.0)
    loads = np.arange(20.0, torque[-1], 20.0)
    below, left = 0 * rpm + torque[0] - 3.0, 0 * loads + engine_speed[0]
    ticks = np.vstack([cells(rpm / _RPM, below), cells(left, loads)])
    labels = [f"{value:.0f} rpm" for value in rpm] + [f"{value:.0f} N m" for value in loads]
    out.static(
        "engine_map/ticks", rr.Points2D(ticks, labels=labels, show_labels=True, radii=[0.2], colors=[(90, 90, 90)])
    )


def _used(mask: NDArray[np.bool_]) -> slice:
    """From the first to the last cell in use; all, if none is."""
    cells = np.flatnonzero(mask)
    return slice(int(cells[0]), int(cells[-1]) + 1) if len(cells) > 1 else slice(None)


def _plan(east: Array, north: Array) -> Array:
    """Seen from above with north up: the viewer's y axis points down."""
    return np.column_stack([east, -north])


def _rgb(colour: str) -> Sequence[int]:
    return [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
