"""The compiled step against its readable reference, and the balances that hold to rounding."""

from dataclasses import replace

import numpy as np
import pytest

from vehicle_model.car.effects import neutral_settings
from vehicle_model.car.files import read_car
from vehicle_model.car.randomness import generator
from vehicle_model.plant import kernel, reference
from vehicle_model.plant.cycle import energy_account, read_cycle, run_cycle
from vehicle_model.plant.effects import EFFECTS
from vehicle_model.plant.parameters import plant_parameters

ALL_MIDDLE = {f"{e.id}.{p.name}": p.middle for e in EFFECTS for p in e.parameters}


def variator(name: str):
    car = read_car(name)
    return replace(car, driveline=replace(car.driveline, continuously_variable=True))


def wild_commands(seed: int, steps: int, gears: int):
    """Forces from full braking to full load and any gear, each held for 1.2 s."""
    rng = generator(seed, "wild driver")
    force, gear = 3000.0, 1
    for n in range(steps):
        if n % 120 == 0:
            force = float(rng.choice([0.0, rng.uniform(-4000, 100), *rng.uniform(500, 6000, 2), rng.uniform(0, 1200)]))
            if rng.random() < 0.5:
                gear = int(rng.choice([1, 1, *range(gears + 1)]))
        road = (0.03 * np.sin(n / 900), 0.012 * np.sin(n / 300), 0.001 * np.cos(n / 200), n / 800.0)
        yield n, force, float(gear), road


CASES = [
    ("smart", read_car("smart"), {}),
    ("peugeot, every effect at once", read_car("peugeot"), ALL_MIDDLE | {"idle_fuel.stop_after": 1.0}),
    ("variator", variator("smart"), {"head_wind.speed": 5.0}),
    ("worn clutch", read_car("smart"), {"clutch_slip.capacity": 0.7}),
]


@pytest.mark.parametrize(("name", "car", "settings"), CASES, ids=[case[0] for case in CASES])
def test_the_kernel_is_its_reference(name, car, settings):
    """Given the same state, when both take a step, then every state, energy and output agrees to 1e-12.

    Forces are compared on the scale of the forces that are added up to give them.
    """
    p = plant_parameters(car, settings)
    named = reference.parameters_by_name(p)
    x = np.zeros(kernel.STATES)
    kernel.initial_state(p, x, 0.0, 0.0)
    gears = 1 if car.driveline.continuously_variable else len(car.gear_ratios)
    scale = np.ones(kernel.STATES)
    scale[[kernel.Y_THRUST, kernel.Y_BRAKE, kernel.Y_ROAD_LOAD, kernel.X_TYRE_FORCE, kernel.Y_FUEL_POWER]] = 1e4
    scale[[kernel.Y_ENGINE_TORQUE, kernel.X_BOOST]] = 1e2
    seen = set()
    for n, force, gear, road in wild_commands(7, 8000, gears):
        s = reference.State.of(x)
        kernel.step(p, x, force, gear, *road, 0.01)
        reference.step(named, s, force, gear, *road, 0.01)
        difference = np.abs(x - s.vector()) / np.maximum(np.abs(x), scale)
        assert difference.max() < 1e-12, (n, int(difference.argmax()))
        seen.add((x[kernel.X_CLUTCH], x[kernel.X_CUT]))
    assert {clutch for clutch, _ in seen} == {0.0, 1.0, 2.0} and {cut for _, cut in seen} == {0.0, 1.0}


@pytest.mark.parametrize(("name", "car", "settings"), CASES, ids=[case[0] for case in CASES])
def test_no_joule_is_lost(name, car, settings):
    """Given a wild drive, then fuel = losses + work + stored energy, and the axle's work is all found on the road."""
    p = plant_parameters(car, settings)
    x = np.zeros(kernel.STATES)
    kernel.initial_state(p, x, 0.0, 0.0)
    start = x.copy()
    gears = 1 if car.driveline.continuously_variable else len(car.gear_ratios)
    for _, force, gear, road in wild_commands(11, 60_000, gears):
        kernel.step(p, x, force, gear, *road, 0.01)
    account = energy_account(p, start, x)
    assert account.fuel > 1e6
    assert abs(account.imbalance) < 1e-9
    assert abs(account.wheel_imbalance) < 1e-9
    for loss in (
        "exhaust_and_cooling",
        "friction",
        "pumping",
        "accessories",
        "clutch",
        "gearbox",
        "wheel_slip",
        "drag",
    ):
        assert getattr(account, loss) > 0.0, loss
    assert np.isfinite(x).all()


@pytest.mark.parametrize("cycle", ["udds", "hwfet", "us06", "wltc"])
@pytest.mark.parametrize("name", ["smart", "peugeot"])
def test_every_cycle_closes(cycle, name):
    """The issue's figure: the account of each cycle closes to 1e-6 of its fuel; the car keeps up with the trace."""
    trace = read_cycle(cycle)
    trip, account = run_cycle(read_car(name), trace)
    assert abs(account.imbalance) < 1e-6 and abs(account.wheel_imbalance) < 1e-6
    error = trip.speed - np.interp(trip.time, trace.time, trace.speed)
    assert np.sqrt(np.mean(error**2)) < 0.25
    assert trip.fuel_energy[-1] == pytest.approx(account.fuel)
    # kinetic energy, potential energy and distance of the trip itself, apart from the kernel's own sums
    assert np.trapezoid(trip.speed, trip.time) == pytest.approx(trip.distance[-1], rel=1e-6)
    assert np.sum(trip.fuel_power[1:]) * trip.step == pytest.approx(account.fuel, rel=1e-9)


def test_neutral_is_bit_identical_to_nominal():
    """Given every effect set to its neutral value, then parameters and trip have the nominal car's bits."""
    car = read_car("smart")
    nominal, neutral = plant_parameters(car), plant_parameters(car, neutral_settings(EFFECTS))
    assert nominal.tobytes() == neutral.tobytes()
    a, _ = run_cycle(car, "hwfet")
    b, _ = run_cycle(car, "hwfet", neutral_settings(EFFECTS))
    assert all(a.channels[name].tobytes() == b.channels[name].tobytes() for name in a.channels)


def test_shape_parameters_do_nothing_alone():
    """Given only bearings, time constants and the like away from neutral, then the drive has the nominal's bits."""
    car = read_car("smart")
    shapes = {f"{e.id}.{p.name}": p.high for e in EFFECTS for p in e.parameters if not p.primary}
    shapes.pop("idle_fuel.stop_after")  # its upper end is its neutral value
    nominal, _ = run_cycle(car, "hwfet")
    shaped, _ = run_cycle(car, "hwfet", shapes)
    for name in ("speed", "fuel_energy", "thrust", "engine_speed", "road_load"):
        assert nominal.channels[name].tobytes() == shaped.channels[name].tobytes(), name
