"""A trip on the map, as the thesis' Google Earth files show it (seed 004, appendix F): path and speed by colour, start
and stop by thumbtacks, trip time by blue boxes with numbers."""

import itertools
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pygeoif.geometry import LineString, Point

from sensors.projection import to_geodetic
from vehicle_model.car.trip import Trip

with warnings.catch_warnings():
    # Says on import that pretty printing needs lxml; nobody reads these files line by line.
    warnings.simplefilter("ignore", UserWarning)
    import fastkml
    from fastkml.enums import AltitudeMode

FULL_SPEED = 180.0 / 3.6
"""m/s shown as the deepest red."""
SHADES = 64
STEP = 1.0
"""s between points of the path."""
BOX = 60.0
"""s between the boxes that tell the trip time."""
ICONS = "http://maps.google.com/mapfiles/kml/"
BLUE = "ffff0000"


def jet(share: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the colours (n, 3), red, green, blue, 0 to 255, of Matlab's "jet" for `share` (n,), cut to 0 .. 1."""
    share = np.clip(share, 0.0, 1.0)[:, None]
    middle = np.array([3.0, 2.0, 1.0])
    return np.round(255.0 * np.clip(1.5 - np.abs(4.0 * share - middle), 0.0, 1.0)).astype(np.uint8)


def write_kml(trip: Trip, path: Path, name: str = "") -> None:
    """Write `trip` as KML, aside and then renamed. `name` is shown; the file's own name if empty."""
    t = np.arange(trip.time[0], trip.time[-1] + 0.5 * STEP, STEP)
    columns = [np.interp(t, trip.time, getattr(trip, key)) for key in ("north", "east", "altitude", "speed")]
    latitude, longitude = to_geodetic(columns[0], columns[1], trip.origin)
    write_track(t - trip.time[0], latitude, longitude, columns[2], columns[3], path, name or path.stem)


def write_track(
    t: NDArray[np.float64],
    latitude: NDArray[np.float64],
    longitude: NDArray[np.float64],
    altitude: NDArray[np.float64],
    speed: NDArray[np.float64],
    path: Path,
    name: str,
) -> None:
    """Write a track (n,): s since the start, deg, deg, m, m/s. Path pieces of one shade are joined to one line."""
    shade = np.minimum((np.clip(speed / FULL_SPEED, 0.0, 1.0) * SHADES).astype(int), SHADES - 1)
    colours = jet((np.arange(SHADES) + 0.5) / SHADES)
    styles = [_icon_style(key, href, colour) for key, href, colour in (
        ("start", "pushpin/grn-pushpin.png", None), ("stop", "pushpin/red-pushpin.png", None),
        ("box", "shapes/placemark_square.png", BLUE),
    )]  # fmt: skip
    for number in np.unique(shade):
        red, green, blue = (int(part) for part in colours[number])
        stroke = fastkml.LineStyle(color=f"ff{blue:02x}{green:02x}{red:02x}", width=5.0)
        styles.append(fastkml.Style(id=f"speed{number}", styles=[stroke]))
    document = fastkml.Document(name=name, styles=styles)
    places = np.column_stack((longitude, latitude, altitude)).round(7)
    path_folder = fastkml.Folder(name="speed, dark blue 0 to deep red 180 km/h")
    cuts = np.concatenate(([0], np.flatnonzero(np.diff(shade[:-1])) + 1, [max(t.size - 1, 0)]))
    for begin, end in itertools.pairwise(cuts):
        if end > begin:
            line = LineString([(float(x), float(y), float(z)) for x, y, z in places[begin : end + 1]])
            path_folder.append(_placemark(line, f"speed{shade[begin]}"))
    document.append(path_folder)
    marks = fastkml.Folder(name="trip time, s")
    for when in np.arange(BOX, t[-1], BOX):
        row = int(np.searchsorted(t, when))
        marks.append(_placemark(Point(*map(float, places[row])), "box", f"{when:.0f}"))
    document.append(marks)
    document.append(_placemark(Point(*map(float, places[0])), "start", "Start"))
    document.append(_placemark(Point(*map(float, places[-1])), "stop", "Stop"))
    tree = fastkml.KML(features=[document])
    aside = path.with_name(path.name + ".part")
    try:
        aside.write_text('<?xml version="1.0" encoding="UTF-8"?>\n' + tree.to_string(), encoding="utf-8")
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def _icon_style(key: str, href: str, colour: str | None) -> fastkml.Style:
    return fastkml.Style(id=key, styles=[fastkml.IconStyle(icon=fastkml.Icon(href=ICONS + href), color=colour)])


def _placemark(geometry: LineString | Point, style: str, name: str | None = None) -> fastkml.Placemark:
    shape = fastkml.create_kml_geometry(geometry, altitude_mode=AltitudeMode.clamp_to_ground)
    return fastkml.Placemark(name=name, style_url=fastkml.StyleUrl(url=f"#{style}"), kml_geometry=shape)
