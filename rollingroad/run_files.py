"""A run read back from its folder: for the views, the gallery and anything that looks at a run later."""

import json
from pathlib import Path

import numpy as np

from controller.advice_files import read_advice
from observer import mapping
from observer.estimate_files import read_estimate
from observer.fits import fit_all
from rollingroad.catalogue import plant_keys
from rollingroad.run import Run
from sensors.packets import read_log
from sim.true_efficiency import true_efficiency
from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car
from vehicle_model.car.route import Route
from vehicle_model.car.trip import Trip

_SPACING = 5.0
"""m between the places of a route read back."""


def read_run(folder: Path) -> Run:
    """Read what `rollingroad run` left in `folder`. Raises BadInput naming the file that is missing or damaged.

    The route is taken from the baseline's drive, the fits are fitted again, the true map is computed again from the
    car and the settings in run.json. What the advisor knew of the road is not kept: `road_ahead` is None.
    """
    results = read_results(folder)
    car = read_car(folder / "car.xml")
    baseline, advised = (_trip(folder / part / "truth.parquet") for part in ("", "advised"))
    found = mapping.read(folder)
    keys = plant_keys()
    settings = {key: value for key, value in (results.get("settings") or {}).items() if key in keys}
    truth = true_efficiency(car, settings, [baseline])
    return Run(
        results=results,
        car=car,
        route=route_driven(baseline),
        baseline=baseline,
        advised=advised,
        log=read_log(folder / "log.dat"),
        estimate=read_estimate(folder / "estimate.parquet"),
        efficiency_map=found,
        fits=fit_all(found, car),
        advice=read_advice(folder / "advice.parquet"),
        true_efficiency=truth(*np.meshgrid(found.engine_speed, found.torque, indexing="ij")),
        road_ahead=None,
        folder=folder,
    )


def route_driven(trip: Trip) -> Route:
    """The route as the trip met it, every few metres from its first place to its last."""
    s = np.arange(trip.distance[0], trip.distance[-1], _SPACING)
    places, first = np.unique(trip.distance, return_index=True)

    def over(name: str) -> np.ndarray:
        return np.interp(s, places, trip.channels[name][first])

    def held(name: str) -> np.ndarray:
        rows = first[np.clip(np.searchsorted(places, s, side="right") - 1, 0, len(places) - 1)]
        return trip.channels[name][rows]

    smooth = ("north", "east", "altitude", "heading", "pitch", "straightness", "vertical_straightness")
    return Route(
        s=s,
        **{name: over(name) for name in smooth},
        speed_limit=held("speed_limit"),
        sky=held("sky").astype(np.int8),
        origin=trip.origin,
    )


def read_results(folder: Path) -> dict:
    """The object of `run --json` that the run `folder` holds. Raises BadInput where there is none."""
    path = folder / "run.json"
    try:
        return json.loads(path.read_text())
    except FileNotFoundError as error:
        raise BadInput(folder, "run.json", "expected a run folder, but there is no such file") from error
    except json.JSONDecodeError as error:
        raise BadInput(path, f"line {error.lineno}", "expected JSON as `rollingroad run` writes it") from error


def _trip(path: Path) -> Trip:
    try:
        return Trip.read(path)
    except FileNotFoundError as error:
        raise BadInput(path, "", "expected a drive (truth.parquet), but there is no such file") from error
    except (KeyError, ValueError, OSError) as error:
        raise BadInput(path, "", f"expected a drive as `rollingroad drive` writes it ({error})") from error
