"""The plant and its mirror are one car; the same seed is the same traffic; nobody is endangered."""

import numpy as np
import pytest

from scenarios import files
from sim.advisor import Suggestion, View
from sim.caution import speed_cap
from sim.drive import drive
from sim.drive_record import Drive
from sim.network import Network
from sim.traffic import MirrorError, Traffic
from vehicle_model.car.parameters import Car
from vehicle_model.plant.session import Plant


class EaseOff:
    """Advice from 400 m on: never more than 0.3 m/s2, top gear."""

    def reset(self) -> None:
        self.views: list[View] = []

    def advise(self, view: View) -> Suggestion | None:
        self.views.append(view)
        return Suggestion(0.3, 6) if view.distance > 400.0 else None


@pytest.fixture(scope="module")
def advised(mixed: Network, car: Car) -> tuple[Drive, EaseOff]:
    advisor = EaseOff()
    return drive(files.load("mixed"), car, 3, advisor=advisor, network=mixed), advisor


def test_baseline_arrives_safely_in_traffic(baseline: Drive) -> None:
    assert baseline.arrived
    assert baseline.collisions == 0 and baseline.red_lights_run == 0 and baseline.limit_violations == 0
    assert baseline.min_time_to_collision > 1.0
    assert 45.0 < baseline.vehicles < 75.0
    trip = baseline.trip
    assert 12_000 < trip.distance[-1] < 15_000
    assert abs(trip.speed[-1]) < 0.1 and baseline.parked_s >= 4.0


def test_fuel_is_plausible(baseline: Drive, car: Car) -> None:
    litres = baseline.trip.fuel_energy[-1] / (car.fuel.heating_value * car.fuel.density) * 1e3
    assert 3.0 < litres / (baseline.trip.distance[-1] / 1e5) < 9.0


def test_bends_are_taken_with_comfort(baseline: Drive) -> None:
    trip = baseline.trip
    sideways = np.abs(trip.straightness) * trip.speed**2
    assert np.quantile(sideways, 0.999) < 3.0
    assert np.all(np.diff(speed_cap(baseline.route, 2.2) ** 2) > -2.0 * 1.5 * 1.0 - 1e-9)


def test_same_seed_same_bits_and_another_seed_other_traffic(baseline: Drive, mixed: Network, car: Car) -> None:
    again = drive(files.load("mixed"), car, 3, network=mixed)
    assert again.step_hashes == baseline.step_hashes
    for name, channel in baseline.trip.channels.items():
        assert channel.tobytes() == again.trip.channels[name].tobytes(), name
    assert drive(files.load("mixed"), car, 4, network=mixed).step_hashes[:50] != baseline.step_hashes[:50]


class Flicker(EaseOff):
    """Changes its mind before the driver has acted upon the first word."""

    def advise(self, view: View) -> Suggestion | None:
        self.views.append(view)
        if view.distance <= 400.0:
            return None
        return Suggestion(0.8 if len(self.views) % 6 < 3 else -0.8, 3)


def test_a_display_that_is_lit_may_already_change_the_drive(baseline: Drive, mixed: Network, car: Car) -> None:
    """Given glances at a display that flickers at once, then whatever they change comes after the first advice."""
    after = drive(files.load("mixed"), car, 3, advisor=Flicker(), network=mixed)
    same = np.array(after.step_hashes[:3000]) == np.array(baseline.step_hashes[:3000])
    assert after.first_advice_step is not None and np.argmin(same) >= after.first_advice_step


def test_drives_are_bit_equal_until_the_first_advice(baseline: Drive, advised: tuple[Drive, EaseOff]) -> None:
    after, _ = advised
    first = after.first_advice_step
    assert first is not None and first > 300
    assert after.step_hashes[:first] == baseline.step_hashes[:first]
    assert after.step_hashes[first : first + 100] != baseline.step_hashes[first : first + 100]
    rows = 10 * first
    assert np.array_equal(after.trip.speed[:rows], baseline.trip.speed[:rows])


def test_advice_is_followed_but_never_against_safety(advised: tuple[Drive, EaseOff]) -> None:
    after, advisor = advised
    assert after.arrived and after.collisions == 0 and after.red_lights_run == 0 and after.limit_violations == 0
    assert after.advised_share > 0.3
    far = after.trip.distance > 600.0
    assert np.quantile(after.trip.acceleration[far], 0.99) < 1.0
    assert all(view.speed >= 0.0 and view.signal_state in ("", "red", "yellow", "green") for view in advisor.views)
    assert any(view.signal_state == "red" for view in advisor.views)


def test_the_advisor_is_shown_no_more_than_a_dashboard() -> None:
    assert set(View.__dataclass_fields__) == {
        "time", "distance", "speed", "gear", "leader_gap", "leader_speed", "signal_distance", "signal_state",
        "destination_distance",
        "told_distance", "told_green",  # what a signal itself tells, where it does
    }  # fmt: skip


def test_a_mirror_that_drifts_voids_the_drive(mixed: Network, car: Car, monkeypatch: pytest.MonkeyPatch) -> None:
    """Given SUMO's own speed checks left on, when the ego must obey the plant, then the drive is refused."""
    import libsumo

    monkeypatch.setattr(libsumo.vehicle, "setSpeedMode", lambda name, mode: None)
    monkeypatch.setattr(Plant, "distance", property(lambda self: 3.0 * float(self.state[0]) + 5.0 * self.time**2))
    with pytest.raises(MirrorError, match="mirror"):
        drive(files.load("mixed"), car, 3, network=mixed)


def test_a_second_simulation_starts_after_a_failed_one(mixed: Network, tmp_path) -> None:
    from scenarios.schema import Scenario
    from sim.demand import demand

    scenario: Scenario = files.load("mixed")
    routes = tmp_path / "routes.xml"
    routes.write_text(demand(scenario, mixed, 0, '<vType id="ego"/>', 100.0))
    for _ in range(2):
        with pytest.raises(ZeroDivisionError), Traffic(mixed, routes, 0) as traffic:
            assert traffic.begin(60.0)
            raise ZeroDivisionError
