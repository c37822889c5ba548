"""The plant's rows of the effect catalogue: physics of the car that simulators usually leave out.

Sources: [EPA] computed from the EPA 2022 test-car list; [C] CO2MPAS 4.3.7 defaults; [meas] measured on public logs;
(M) textbook memory, to be checked before it becomes a prior. A real wind sets `head_wind` and `cross_wind` together:
the first row is its part along the road, the second its part across.
"""

from math import pi

from vehicle_model.car.effects import Effect, Parameter


def _shape(name: str, unit: str, neutral: float, low: float, high: float, source: str) -> Parameter:
    return Parameter(name, unit, neutral, low, high, source, primary=False)


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "head_wind",
        "road_load",
        "Wind along the road",
        (
            Parameter("speed", "m/s", 0.0, -8.0, 8.0, "0-8 m/s; 10 km/h head wind at 100 km/h: drag +21 %"),
            _shape("from", "rad", 0.0, -pi, pi, "heading from which it blows"),
            _shape("gust", "", 0.0, 0.0, 0.6, "relative amplitude; gust factor 1.2-1.6 (M)"),
            _shape("gust_period", "s", 20.0, 5.0, 120.0, "(M)"),
        ),
        ("road_load",),
        ("drag_area",),
    ),
    Effect(
        "cross_wind",
        "road_load",
        "Wind across the road",
        (
            Parameter("speed", "m/s", 0.0, 0.0, 10.0, "+5..15 % Cd at 10 deg of flow angle (M)"),
            _shape("from", "rad", pi / 2.0, -pi, pi, "heading from which it blows"),
            _shape("growth", "1/rad2", 3.3, 1.6, 5.0, "Cd(beta) = Cd (1 + growth beta^2): +5..15 % at 10 deg (M)"),
        ),
        ("road_load",),
        ("drag_area",),
    ),
    Effect(
        "rolling_resistance",
        "road_load",
        "Rolling resistance: level, pressure",
        (Parameter("factor", "", 1.0, 0.7, 1.4, "Crr 0.007-0.017; A/(m g) 5/50/95 % 0.0056/0.0092/0.0131 [EPA]"),),
        ("road_load",),
        ("grade_map_error", "brake_drag", "mass"),
    ),
    Effect(
        "tyre_warm_up",
        "road_load",
        "Cold tyres",
        (
            Parameter("amount", "", 0.0, 0.0, 0.5, "cold +40 % (C&D 1979)"),
            _shape("time", "s", 720.0, 480.0, 1200.0, "8-20 min"),
            _shape("fast_share", "", 0.0, 0.0, 1.0, "share of a second, faster exponential"),
            _shape("fast_time", "s", 120.0, 30.0, 300.0, "carcass against tread (M)"),
        ),
        ("road_load",),
        ("cold_start", "gearbox_oil_cold"),
    ),
    Effect(
        "mass",
        "road_load",
        "Payload",
        (Parameter("factor", "", 1.0, 0.9, 1.25, "4 passengers and luggage: +5..25 %"),),
        ("acceleration", "road_load"),
        ("grade_map_error",),
    ),
    Effect(
        "drag_area",
        "road_load",
        "Drag area: roof box, windows",
        (Parameter("factor", "", 1.0, 0.9, 1.5, "roof box +10..25 % fuel (LBNL/NREL); CdA 0.48/0.72/1.01 m2 [EPA]"),),
        ("road_load",),
        ("air_density", "head_wind"),
    ),
    Effect(
        "air_density",
        "road_load",
        "Air density",
        (Parameter("factor", "", 1.0, 0.79, 1.13, "0.95-1.35 kg/m3: -10 % per 900 m, +1 % per -3 K"),),
        ("road_load",),
        ("drag_area",),
    ),
    Effect(
        "cold_start",
        "engine_fuel",
        "Engine warm-up",
        (
            Parameter("temperature", "K", 363.15, 253.15, 363.15, "soak -20 C to thermostat"),
            _shape("exponent", "", 4.0, 3.0, 8.0, "friction x (T/T_target)^-t, t 3.5-4.5 (0-8) [C]"),
            _shape(
                "energy", "J/m3", 1.5e9, 0.5e9, 5.0e9, "fuel per displacement that warms the coolant by 1 - 1/e [meas]"
            ),
            _shape("oil_energy", "J/m3", 4.0e9, 1.5e9, 12.0e9, "the same of the oil: one exponential is not enough"),
            _shape("oil_share", "", 0.4, 0.0, 1.0, "share of the friction that follows the oil (M)"),
            _shape("enrichment", "", 1.0, 0.0, 2.0, "fuel per (1 - T/T_target): wall wetting (M)"),
        ),
        ("fuel_power", "coolant_temperature"),
        ("accessory_load", "tyre_warm_up", "cranking_fuel"),
    ),
    Effect(
        "cranking_fuel",
        "engine_fuel",
        "Start: cranking fuel, raised idle, catalyst heating",
        (
            Parameter("energy", "J", 0.0, 0.0, 60e3, "first 60 s +79 % (Camry) [meas]"),
            Parameter("idle_raise", "rad/s", 0.0, 0.0, 60.0, "+300..600 rpm (M)"),
            Parameter("retard", "", 0.0, 0.0, 0.5, "fuel by spark retard, fading (M)"),
            _shape("time", "s", 45.0, 15.0, 90.0, "30-90 s"),
        ),
        ("fuel_power", "engine_speed"),
        ("cold_start",),
    ),
    Effect(
        "gearbox_oil_cold",
        "driveline",
        "Cold gearbox oil",
        (
            Parameter("amount", "", 0.0, 0.0, 4.0, "first 5-10 km, 1-3 % (M): churning several times the warm one"),
            _shape("distance", "m", 4000.0, 2000.0, 8000.0, "first 5-10 km (M)"),
        ),
        ("fuel_power",),
        ("tyre_warm_up", "cold_start"),
    ),
    Effect(
        "accessory_load",
        "accessory",
        "Electrical accessories",
        (Parameter("power", "W", 0.0, -150.0, 1200.0, "added to the car's own; alternator 0.67 x belt 0.80 [C]"),),
        ("fuel_power", "battery_voltage"),
        ("ac_cycling", "injector_dead_time"),
    ),
    Effect(
        "ac_cycling",
        "accessory",
        "Air-conditioning compressor",
        (
            Parameter("power", "W", 0.0, 0.0, 5000.0, "+0.9 l/h, at the shaft while on; SC03 +22 % median [EPA]"),
            _shape("period", "s", 30.0, 10.0, 60.0, "cycling 10-60 s"),
            _shape("duty", "", 0.6, 0.1, 1.0, "of the period (M)"),
        ),
        ("fuel_power",),
        ("accessory_load",),
    ),
    Effect(
        "enrichment",
        "engine_fuel",
        "Full-load enrichment",
        (
            Parameter("amount", "", 0.10, 0.0, 0.30, "lambda 0.8-0.95 near full load: +5..25 % fuel"),
            Parameter("load", "", 0.85, 0.60, 0.95, "share of the full load where it begins"),
        ),
        ("fuel_power",),
        ("map_drift",),
    ),
    Effect(
        "fuel_cutoff",
        "engine_fuel",
        "Overrun fuel cut-off",
        (
            Parameter("share", "", 1.0, 0.0, 1.0, "of the fuel that overrun cuts; 9-15 % of moving samples [meas]"),
            Parameter("resume", "rad/s", 30.0, 10.0, 120.0, "above idle, engine speed where fuel returns (M)"),
        ),
        ("fuel_power",),
        (),
    ),
    Effect(
        "idle_fuel",
        "engine_fuel",
        "Idle fuel, stop-start",
        (
            Parameter("factor", "", 1.0, 0.7, 1.6, "0.2-0.4 g/s; Camry 0.13-0.20 cc/s [meas]"),
            _shape("stop_after", "s", 3600.0, 0.5, 3600.0, "standstill after which the engine stops"),
        ),
        ("fuel_power",),
        ("accessory_load", "ac_cycling"),
    ),
    Effect(
        "fuel_energy",
        "engine_fuel",
        "Heating value of the fuel",
        (Parameter("factor", "", 1.0, 0.72, 1.03, "E10 -3.3..-3.5 %, E85 -27 % (M)"),),
        ("fuel_power",),
        ("driveline_loss",),
    ),
    Effect(
        "map_drift",
        "engine_fuel",
        "Drift of the engine map",
        (
            Parameter("size", "", 0.0, -0.06, 0.06, "1-6 % of fuel, local"),
            _shape("speed", "", 0.45, 0.1, 1.0, "centre, share of the redline"),
            _shape("torque", "", 0.45, 0.0, 1.0, "centre, share of the largest torque"),
            _shape("speed_width", "", 0.15, 0.05, 0.5, "share of the redline"),
            _shape("torque_width", "", 0.20, 0.05, 0.5, "share of the largest torque"),
        ),
        ("fuel_power",),
        ("enrichment",),
    ),
    Effect(
        "turbo_lag",
        "engine_fuel",
        "Lag of the torque that comes late",
        (Parameter("time", "s", 0.0, 0.0, 1.5, "added to the car's own; 0.3-1.5 s (M)"),),
        ("thrust",),
        ("driver_lag",),
    ),
    Effect(
        "driveline_loss",
        "driveline",
        "Loss in the gears",
        (
            Parameter("share", "", 0.0, -0.02, 0.06, "added share of the torque; eta 0.93-0.98 (M)"),
            Parameter("drag", "", 1.0, 0.5, 3.0, "factor on the torque that is lost at any load (M)"),
        ),
        ("fuel_power",),
        ("fuel_energy",),
    ),
    Effect(
        "clutch_slip",
        "driveline",
        "Slip at launch, worn clutch",
        (
            Parameter("launch", "", 1.0, 0.8, 1.8, "factor on the engine speed at launch; 5-40 kJ a launch (M)"),
            _shape("capacity", "", 1.6, 0.6, 2.0, "torque that the clutch holds / largest engine torque"),
        ),
        ("engine_speed", "fuel_power"),
        ("wheel_slip",),
    ),
    Effect(
        "shift_loss",
        "driveline",
        "Time and energy of a shift",
        (Parameter("time", "s", 0.0, -0.2, 0.6, "added to the car's own; torque gap 0.2-1 s, 0.5-2 % urban (M)"),),
        ("thrust", "engine_speed"),
        ("turbo_lag",),
    ),
    Effect(
        "wheel_slip",
        "wheel",
        "Slip of the driven wheels",
        (Parameter("factor", "", 1.0, 0.5, 4.0, "0-3 % dry, more in the wet; 1 is 30 N per N of axle load"),),
        ("wheel_angle", "engine_speed"),
        ("wheel_radius",),
    ),
    Effect(
        "wheel_radius",
        "wheel",
        "Rolling radius: wear, pressure, growth",
        (
            Parameter("change", "", 0.0, -0.03, 0.02, "wear -1.5..-2 %, pressure -0.3..-1 % (M); 1.2 % [comma2k19]"),
            Parameter("growth", "", 0.0, 0.0, 0.006, "+0.2..0.5 % at speed (M); at 100 km/h, with its square"),
        ),
        ("wheel_angle", "engine_speed"),
        (),
    ),
    Effect(
        "cornering_drag",
        "road_load",
        "Cornering resistance",
        (
            Parameter(
                "factor", "", 1.0, 0.0, 3.0, "1-3 % on winding roads (M); cornering stiffness 10 per rad of weight"
            ),
        ),
        ("road_load",),
        ("head_wind",),
    ),
    Effect(
        "brake_drag",
        "road_load",
        "Dragging brakes",
        (
            Parameter("force", "N", 0.0, 0.0, 60.0, "10-60 N (M)"),
            Parameter("after_braking", "N", 0.0, 0.0, 60.0, "the part that decays after braking (M)"),
            _shape("decay", "s", 60.0, 20.0, 300.0, "(M)"),
        ),
        ("road_load",),
        ("rolling_resistance", "grade_map_error"),
    ),
)
"""Rows 1 to 15, 17 and 19 to 27; the others are declared by `sensors` and `scenarios`."""
