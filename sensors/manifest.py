"""The files that the thesis' observer leaves beside a trip, by their names (seed 004, C.1.3).

NAME, data.mat: every sensor but the GPS. NAME, extract.mat: the GPS. NAME, results.mat: the filter's results. NAME,
DEM.mat: the ways taken (where there is a road map). NAME, gps.txt: the NMEA strings. NAME, spd.kmz: path and speed.
"""

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from sensors.kml import write_track
from sensors.log import SensorLog
from sensors.matching import observations
from sensors.roadmap import RoadMap

GPS_STREAMS = ("gps", "gps_second")


def write_manifest(
    directory: Path,
    name: str,
    log: SensorLog,
    nmea: bytes = b"",
    results: Mapping[str, NDArray] | None = None,
    road_map: RoadMap | None = None,
    metres_per_tick: float = 0.0,
) -> list[Path]:
    """Write the files for the trip `name` into `directory`, each aside and then renamed; return their paths.

    Parameters: `nmea` the receiver's text (`sensors.packets.nmea_text`), `results` arrays of the observer by name
    (no results.mat without), `road_map` and the car's `metres_per_tick` for DEM.mat. SI units.
    """
    directory.mkdir(parents=True, exist_ok=True)
    written = []

    def place(what: str) -> Path:
        path = directory / f"{name}, {what}"
        written.append(path)
        return path

    others = {key: _fields(rows) for key, rows in log.streams.items() if len(rows) and key not in GPS_STREAMS}
    _save(place("data.mat"), others)
    _save(place("extract.mat"), {key: _fields(log[key]) for key in GPS_STREAMS if len(log[key])})
    if results is not None:
        _save(place("results.mat"), {key: np.asarray(values) for key, values in results.items()})
    if road_map is not None:
        found = observations(log, road_map, metres_per_tick)
        change = np.flatnonzero(np.diff(found["link"], prepend=-1.0))
        _save(place("DEM.mat"), {"ways": found["link"][change], "entered": found["t"][change], "nodes": _fields(found)})
    text = place("gps.txt")
    aside = text.with_name(text.name + ".part")
    aside.write_bytes(nmea)
    aside.replace(text)
    fixes = log["gps"][log["gps"]["quality"] > 0]
    if fixes.size > 1:
        _write_kmz(place("spd.kmz"), fixes, name)
    return written


def _fields(rows: NDArray) -> dict[str, NDArray]:
    return {field: rows[field] for field in rows.dtype.names or ()}


def _save(path: Path, content: Mapping[str, object]) -> None:
    aside = path.with_name(path.name + ".part")
    with aside.open("wb") as file:
        savemat(file, dict(content), do_compression=True, oned_as="column")
    aside.replace(path)


def _write_kmz(path: Path, fixes: NDArray, name: str) -> None:
    once = fixes[:: max(1, round(1.0 / max(float(np.median(np.diff(fixes["utc"]))), 1e-3)))]
    track = path.with_name(f".{path.stem}.kml")
    aside = path.with_name(path.name + ".part")
    try:
        write_track(
            once["utc"] - once["utc"][0], once["latitude"], once["longitude"], np.nan_to_num(once["altitude"]),
            np.nan_to_num(once["speed"]), track, name,
        )  # fmt: skip
        with zipfile.ZipFile(aside, "w", zipfile.ZIP_DEFLATED) as archive:
            # A fixed date: the same trip gives the same bytes.
            archive.writestr(zipfile.ZipInfo("doc.kml"), track.read_bytes(), zipfile.ZIP_DEFLATED)
        aside.replace(path)
    finally:
        track.unlink(missing_ok=True)
        aside.unlink(missing_ok=True)
