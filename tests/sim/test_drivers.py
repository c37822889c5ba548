"""The foot rests; the baseline drivers are the ones that are frozen in writing."""

from pathlib import Path

import numpy as np
import pytest

import scenarios
from scenarios import files
from sim.drive import journey
from sim.drivers import STYLES, Foot
from sim.envs.highway_eco import level_road
from sim.traffic import Traffic
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car
from vehicle_model.plant.session import Plant


@pytest.mark.parametrize("around", [0.5, 0.8, 1.0])
def test_a_foot_does_not_dance_on_the_pedal_where_the_engines_drag_is_about_what_is_wanted(
    car: Car, around: float
) -> None:
    """Given a wish that wavers by 0.1 m/s2 around a share of the engine's drag, when rolling for 12 s, then the foot is
    not on and off the pedal again and again (a limit cycle of foot, drag and fuel cut)."""
    plant = Plant(car, level_road(30.0), None, 25.0, 5)
    foot = Foot(car, 0.4, 0.02, 0.1)
    fuel = []
    for k in range(120):
        drag = (around * plant.overrun_force() - plant.road_load) / car.accelerated_mass
        force = foot.force(drag + 0.1 * np.sin(k * 2.1), plant)
        plant.advance(force, 5, 0.1)
        fuel.append(plant.fuel_power > 0.0)
    assert np.count_nonzero(np.diff(fuel[10:])) <= 2


def test_a_lifted_foot_comes_back_for_a_push(car: Car) -> None:
    plant = Plant(car, level_road(30.0), None, 20.0, 5)
    foot = Foot(car, 0.0, 0.02, 0.1)
    for _ in range(20):
        foot.force(0.0, plant, coast=True)
    assert foot.force(0.5, plant) > 0.5 * car.accelerated_mass * 0.5


def test_the_baseline_drivers_are_those_that_are_frozen_in_writing() -> None:
    """The table of scenarios/drivers.md, row by row, against what drives."""
    text = (Path(scenarios.__file__).parent / "drivers.md").read_text()
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| `")
    ]
    assert {row[0].strip("`") for row in rows} == set(STYLES)
    for kind, model, launch, braking, headway, shifts, _ in rows:
        style = STYLES[kind.strip("`")]
        assert (style.model, f"{style.acceleration}", f"{style.deceleration}", f"{style.headway}") == (
            model, launch, braking, headway,
        )  # fmt: skip
        assert style.cheapest_gear == (shifts == "cheapest gear")
        if not style.cheapest_gear:
            assert shifts == f"{style.upshift:.2f} / {style.downshift:.2f}"
    assert STYLES["good"].coasts_before_stop == 150.0 and STYLES["krauss"].dawdling == 0.5
    assert [kind for kind, style in STYLES.items() if style.looks_at_every_step] == ["alert"]


@pytest.mark.parametrize(("kind", "brakes"), [("alert", False), ("eidm", True)])
def test_who_looks_at_every_step_does_not_brake_for_nothing(
    kind: str, brakes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Given a road of one's own, when SUMO's EIDM is driven by a foot, then its plan brakes for nothing where it looks
    every half second only (the frozen `eidm`), and never where it looks at every step."""
    planned: list[float] = []
    asked = Traffic.planned_acceleration

    def noted(traffic: Traffic) -> float:
        planned.append(asked(traffic))
        return planned[-1]

    monkeypatch.setattr(Traffic, "planned_acceleration", noted)
    read = files.load("town")
    alone = read.model_copy(
        update={
            "driver": read.driver.model_copy(update={"kind": kind}),
            "traffic": read.traffic.model_copy(update={"vehicles": 0}),
        }
    )
    for view, _ in journey(alone, read_car("smart"), 520):
        if view.signal_state in ("red", "yellow") or view.time > 160.0:
            planned.pop()
        if view.time > 160.0:
            break
    assert (min(planned) < -1.0) == brakes
