"""What the trips can tell apart before anything is named: classes, their separators, and what cannot be seen at all."""

from collections.abc import Mapping, Sequence

import numpy as np

from rollingroad.gap.calibration import Reduced
from rollingroad.gap.evidence import Posterior, visible
from rollingroad.gap.fits import cosine
from rollingroad.gap.trips import Lexicon, Trip

SUBSYSTEM: Mapping[str, str] = {
    **dict.fromkeys(
        ("head_wind", "cross_wind", "rolling_resistance", "tyre_warm_up", "mass", "drag_area", "air_density",
            "cornering_drag",
         "brake_drag"), "road_load"),
    **dict.fromkeys(("cold_start", "cranking_fuel", "enrichment", "fuel_cutoff", "idle_fuel", "fuel_energy",
        "map_drift",
                     "turbo_lag"), "engine_fuel"),
    **dict.fromkeys(("gearbox_oil_cold", "driveline_loss", "clutch_slip", "shift_loss"), "driveline"),
    **dict.fromkeys(("accessory_load", "ac_cycling"), "accessory"),
    **dict.fromkeys(("injector_dead_time", "injector_fouling"), "injector"),
    **dict.fromkeys(("wheel_radius", "wheel_slip"), "wheel"),
    "grade_map_error": "road_map", "accelerometer_mount": "accelerometer", "gps_lag": "gps", "clock_skew": "clock",
    "driver_lag": "driver", "traffic_actuation": "traffic",
}  # fmt: skip
"""Where each effect lives (EFFECTS.md)."""

SEPARATORS: Mapping[frozenset[str], str] = {
    frozenset({"rolling_resistance", "grade_map_error"}): "drive the route back",
    frozenset(
        {"rolling_resistance", "brake_drag"}
    ): "a coast-down after a long stretch without braking; wheel-end temperature",
    frozenset({"drag_area", "air_density"}): "a barometer and the intake air's temperature",
    frozenset({"drag_area", "head_wind"}): "drive the route back, or on other headings",
    frozenset({"air_density", "head_wind"}): "drive the route back, or on other headings",
    frozenset({"fuel_energy", "injector_fouling"}): "the refilled volume, or the fuel trims",
    frozenset({"driveline_loss", "fuel_energy"}): "coasting and a long idle: a driveline loss is silent there",
    frozenset({"driveline_loss", "injector_fouling"}): "coasting and a long idle: a driveline loss is silent there",
    frozenset({"accessory_load", "injector_dead_time"}): "idle at two engine speeds; battery voltage",
    frozenset({"accessory_load", "ac_cycling"}): "some minutes of idle, to see it cycle",
    frozenset({"accessory_load", "idle_fuel"}): "steady driving: an idle effect is silent there",
    frozenset({"tyre_warm_up", "gearbox_oil_cold"}): "coasting while cold: the tyre shows, the gearbox less",
    frozenset({"tyre_warm_up", "cold_start"}): "coasting and idling while cold",
    frozenset({"cold_start", "cranking_fuel"}): "engine speed in the first minute; a longer trip",
    frozenset({"enrichment", "map_drift"}): "full load at several engine speeds",
    frozenset({"gps_lag", "clock_skew"}): "a longer trip: skew grows, lag does not",
    frozenset({"mass", "driveline_loss"}): "coast-downs on a hill",
}
"""The next best manoeuvre for a pair (EFFECTS.md, "Separators")."""


def separators(effects: Sequence[str]) -> list[str]:
    """What would tell the members of a class apart."""
    found = [text for pair, text in SEPARATORS.items() if pair <= set(effects)]
    return list(dict.fromkeys(found)) or (
        ["a longer trip with stops, coasting, hills and several headings"] if len(effects) > 1 else []
    )


def class_of(effect: str, posterior: Posterior, reduced: Reduced, lexicon: Lexicon) -> list[str]:
    """Effects that these trips do not separate from `effect`: nearly the same signature, or nearly as probable."""
    own_variant, own = posterior.fits[effect]
    index = lexicon.index_of(own_variant)
    members = [effect]
    top = posterior.singles.get(effect, 0.0)
    for other, (variant, fit) in posterior.fits.items():
        if other == effect:
            continue
        alike = cosine(reduced, index, lexicon.index_of(variant))
        close = posterior.singles[other] > 0.15 * max(top, 1e-12)
        if (alike > 0.9 and fit.explained > 0.8 * own.explained) or (close and alike > 0.5):
            members.append(other)
    return sorted(members, key=lambda e: -posterior.singles[e])


def unseen(trips: Sequence[Trip], reduced: Reduced, lexicon: Lexicon, coarse: bool) -> list[tuple[str, str]]:
    """Effects that these logs cannot show, each with the reason."""
    trace = trips[0].p.trace
    gps, fuel = bool(trace.gps), bool(np.isfinite(trace.fuel).any())
    rows = {
        "turbo_lag": "no throttle position in the logs",
        "driver_lag": "no advice in the logs",
        "traffic_actuation": "no distance to the leader in the logs",
    }
    seen = visible(reduced, lexicon)
    for effect, ratio in seen.items():
        if ratio >= 1.0:
            continue
        if coarse and effect in ("clutch_slip", "shift_loss", "injector_dead_time", "injector_fouling"):
            rows[effect] = "no engine speed in the logs"
        elif not gps and effect in (
            "gps_lag",
            "wheel_radius",
            "wheel_slip",
            "head_wind",
            "cross_wind",
            "clock_skew",
            "accelerometer_mount",
        ):
            rows[effect] = "no receiver in the logs"
        elif effect == "grade_map_error":
            rows[effect] = "no road map under the trips" if gps else "no receiver in the logs"
        elif not fuel and SUBSYSTEM.get(effect) in ("engine_fuel", "accessory", "driveline", "road_load", "injector"):
            rows[effect] = "no fuel in the logs"
        else:
            rows[effect] = "its plausible size stays below the noise of these trips"
    return sorted(rows.items())
