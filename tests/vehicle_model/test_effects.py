"""Each effect changes what it is said to change, with its sign and about its size, and nothing else."""

import re
from pathlib import Path

import numpy as np
import pytest

from vehicle_model.car.effects import SUBSYSTEMS, Effect, Parameter, complete_settings
from vehicle_model.car.errors import BadInput
from vehicle_model.car.files import read_car
from vehicle_model.plant.cycle import replay
from vehicle_model.plant.effects import EFFECTS
from vehicle_model.plant.parameters import plant_parameters
from vehicle_model.plant.signatures import nominal_drive, proving_ground, settings_of, signature

IDS = [(effect, part.name) for effect in EFFECTS for part in effect.parameters if part.primary]


@pytest.fixture(scope="module")
def smart():
    car, track = read_car("smart"), proving_ground()
    return car, track, *nominal_drive(car, track)


# id.parameter: fuel of the drive at the middle of the range, low and high, %
SIZES = {
    "head_wind.speed": (1.0, 9.0),  # EFFECTS: 7.8 on one heading; here every heading
    "cross_wind.speed": (0.3, 4.0),
    "rolling_resistance.factor": (2.0, 4.5),  # 3.3
    "tyre_warm_up.amount": (0.4, 2.0),  # 1.2 at 35 %
    "mass.factor": (2.5, 7.0),  # 4.9 per 10 %
    "drag_area.factor": (4.0, 10.0),  # 4.1 per 15 %
    "air_density.factor": (-5.0, -1.5),  # -2.7 per -10 %
    "cold_start.temperature": (0.5, 6.0),
    "gearbox_oil_cold.amount": (0.2, 3.0),  # 1-3 % of the first kilometres
    "accessory_load.power": (4.0, 13.0),  # 100 W = 0.1 l/100 km
    "ac_cycling.power": (6.0, 22.0),  # +0.9 l/h; SC03 +22 %
    "enrichment.amount": (0.02, 3.0),
    "fuel_cutoff.share": (0.7, 6.0),  # 6.0 with none at all
    "idle_fuel.factor": (0.2, 2.0),  # 0.6 per 20 %
    "fuel_energy.factor": (15.0, 17.5),  # 1 / 0.86
    "map_drift.size": (0.2, 3.0),
    "driveline_loss.share": (1.5, 3.5),  # 2.6 per 3 %
    "shift_loss.time": (0.05, 2.0),  # 0.5-2 % urban
    "cornering_drag.factor": (0.3, 3.0),
    "brake_drag.force": (2.5, 6.0),  # 4.9 at 40 N
}

# which residual an effect's subsystem shows itself in, and below what the others stay (N, fractions, rad/s)
OWN = {
    "road_load": "road",
    "driveline": "driveline",
    "engine_fuel": "map",
    "accessory": "map",
    "wheel": "wheel",
}
QUIET = {"road": 2.0, "driveline": 1.0, "map": 0.0015, "wheel": 0.0008, "coolant": 0.5, "voltage": 1e-9, "idle": 0.002}
# what an effect may show beside its subsystem's residual, and why
ALSO = {
    "mass": {"road"},
    "cold_start": {"coolant", "idle"},
    "cranking_fuel": {"idle"},
    "accessory_load": {"idle", "voltage"},
    "ac_cycling": {"idle"},
    "idle_fuel": {"idle"},
    "fuel_energy": {"idle", "coolant"},
    "wheel_slip": {"driveline"},  # work lost between axle and road, at the car's speed
    "wheel_radius": {"driveline"},  # another lever
}
# these act in passing: at the launch, the shift, the blow of the charger, the first seconds
PASSING = {"clutch_slip", "shift_loss", "turbo_lag", "cranking_fuel", "idle_fuel"}


@pytest.mark.parametrize(("effect", "parameter"), IDS, ids=[f"{e.id}.{p}" for e, p in IDS])
def test_an_effect_changes_its_channels_and_no_others(effect: Effect, parameter: str, smart):
    car, track, nominal, gear = smart
    found = signature(car, settings_of(effect, parameter), track, nominal, gear)
    own = OWN[effect.subsystem]
    if effect.id not in PASSING:
        assert abs(getattr(found, own)) > 0.5 * QUIET[own], f"nothing in {own}"
    elif effect.id == "clutch_slip":
        assert found.engine_speed > 0.005, "the engine runs ahead of the gear at launch"
    elif effect.id in ("shift_loss", "turbo_lag"):
        assert found.thrust > 5.0
    for residual, limit in QUIET.items():
        if residual != own and residual not in ALSO.get(effect.id, ()):
            assert abs(getattr(found, residual)) < limit, f"{residual}: {getattr(found, residual)}"
    if (sizes := SIZES.get(f"{effect.id}.{parameter}")) is not None:
        assert sizes[0] < 100.0 * found.fuel < sizes[1]


def test_a_head_wind_is_a_tail_wind_on_the_way_back():
    """Given wind from the north, then driving south it pushes by as much as EFFECTS 1's equation says."""
    car = read_car("smart")
    p = plant_parameters(car, {"head_wind.speed": 5.0})
    nominal = plant_parameters(car)
    time, speed = np.arange(0.0, 40.0), np.full(40, 25.0)

    def load(parameters, heading: float) -> float:
        return replay(parameters, time, speed, np.full(40, 5), heading=np.full(40, heading))["road_load"][-1]

    for heading, along in ((0.0, 5.0), (np.pi, -5.0), (np.pi / 2.0, 0.0)):
        expected = car.air_density * car.drag_area * (25.0 * along + 0.5 * along**2)
        assert load(p, heading) - load(nominal, heading) == pytest.approx(expected, abs=1.0)


def test_cold_friction_is_what_co2mpas_says():
    """Given 23 C, then idle friction is (296 / 363)^-4 = 2.26 of the warm engine's, and fades with the fuel burnt."""
    car = read_car("peugeot")
    time = np.arange(0.0, 900.0)
    cold = replay(plant_parameters(car, {"cold_start.temperature": 296.15}), time, np.zeros(900))
    warm = replay(plant_parameters(car), time, np.zeros(900))
    ratio = cold["fuel_power"][20:] / warm["fuel_power"][20:]
    assert 1.4 < ratio[0] < 2.5  # CO2MPAS: 2.5 at no load and 2000 rpm
    assert np.all(np.diff(ratio) < 1e-9), "it fades"
    assert ratio[-1] < 1.0 + 0.5 * (ratio[0] - 1.0)
    # two time scales: the logarithm of the excess is no straight line
    excess = np.log(ratio - 1.0)
    first, second = excess[2000] - excess[0], excess[-1] - excess[-2001]
    assert first < 1.1 * second < 0.0


def test_the_catalogue_is_sound():
    ids = [effect.id for effect in EFFECTS]
    assert len(set(ids)) == len(ids)
    for effect in EFFECTS:
        assert effect.subsystem in SUBSYSTEMS and any(part.primary for part in effect.parameters)
        for part in effect.parameters:
            assert part.low <= part.neutral <= part.high and part.low < part.high
            assert part.source or not part.primary
            assert part.middle != part.neutral


def test_rows_are_refused_that_make_no_sense():
    part = Parameter("speed", "m/s", 9.0, 0.0, 8.0, "x")
    with pytest.raises(ValueError, match="neutral"):
        Effect("x", "road_load", "", (part,))
    with pytest.raises(ValueError, match="subsystem"):
        Effect("x", "magic", "", ())
    with pytest.raises(BadInput, match=r"drag_area\.factor"):
        complete_settings({"drag_area.factor": 9.0}, EFFECTS)


def test_the_documentation_lists_every_parameter():
    text = (Path(__file__).parents[2] / "docs" / "effects.md").read_text()
    for effect in EFFECTS:
        for part in effect.parameters:
            row = re.search(
                rf"\| `{effect.id}` \| `{part.name}` \| [^|]*\| {re.escape(f'{part.neutral:.4g}')} \|", text
            )
            assert row, f"{effect.id}.{part.name}: run python -m vehicle_model.plant.signatures > docs/effects.md"
