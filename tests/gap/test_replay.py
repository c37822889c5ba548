"""The inverse replay against the forward plant: what the plant burns on its own drive, the replay must find again."""

import numpy as np
import pytest

from rollingroad.gap.replay import Motion, replay
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car
from vehicle_model.plant.cycle import run_cycle


@pytest.fixture(scope="module")
def smart() -> Car:
    from importlib import resources
    from pathlib import Path

    return read_car(Path(str(resources.files("vehicle_model.cars").joinpath("smart.xml"))))


def _driven(car: Car, settings: dict[str, float]) -> tuple[Motion, np.ndarray, np.ndarray]:
    """The forward plant's own motion on a town cycle, its fuel, and the samples at which it drives in gear."""
    trip, _ = run_cycle(car, "udds", settings)
    c = {name: column[::20] for name, column in trip.channels.items()}
    step = 0.2
    locked = (c["clutch"] > 0.99) & (c["gear"] > 0)
    steady = np.convolve(locked, np.ones(7), mode="same") > 6.5
    motion = Motion(
        c["time"], c["distance"], c["speed"], c["acceleration"], c["acceleration"] + car.gravity * np.sin(c["pitch"]),
        c["engine_speed"], np.where(locked, c["gear"], 0).astype(int), c["heading"], c["straightness"],
        c["fuel_energy"], np.zeros_like(c["time"]),
    )  # fmt: skip
    del step
    return motion, c["fuel_power"], steady & (c["thrust"] > 100.0)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"mass.factor": 1.15},
        {"drag_area.factor": 1.2},
        {"accessory_load.power": 600.0},
        {"fuel_energy.factor": 0.96},
    ],
)
def test_replayed_plant_burns_what_it_burnt(smart: Car, settings: dict[str, float]) -> None:
    """Given the plant's own drive, when it is replayed under the same settings, then the fuel agrees within 1.5 %."""
    motion, burnt, driving = _driven(smart, settings)
    found = replay(smart, motion, settings).fuel
    assert found[driving].sum() == pytest.approx(burnt[driving].sum(), rel=0.015)


def test_wrong_settings_are_seen(smart: Car) -> None:
    """Given a loaded car's drive, when the unloaded one is replayed, then fuel is missing."""
    motion, burnt, driving = _driven(smart, {"mass.factor": 1.2})
    assert replay(smart, motion).fuel[driving].sum() < 0.97 * burnt[driving].sum()


def test_coasting_force_is_the_overruns(smart: Car) -> None:
    """Given the fuel cut and no brake, then the force that the motion needs is what the overrun gives, within 25 N."""
    trip, _ = run_cycle(smart, "udds")
    c = {name: column[::20] for name, column in trip.channels.items()}
    motion, _, _ = _driven(smart, {})
    coasting = (c["fuel_power"] < 1.0) & (c["brake_force"] < 1.0) & (motion.gear > 0) & (c["speed"] > 5.0)
    coasting &= np.convolve(coasting, np.ones(5), mode="same") > 4.5
    if coasting.sum() < 5:
        pytest.skip("this drive never coasts without the brake")
    r = replay(smart, motion)
    assert np.median(np.abs(r.road_force - r.overrun_force)[coasting]) < 25.0
