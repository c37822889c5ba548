"""Every seed meets the signals at other times; what is coordinated stays so."""

from pathlib import Path

import pytest
from defusedxml.ElementTree import fromstring

from scenarios import files
from sim.network import Network, build
from sim.signals import programmes


def _offsets(network: Network, seed: int) -> dict[str, int]:
    return {row.attrib["id"]: int(row.attrib["offset"]) for row in fromstring(programmes(network, seed))}


def test_a_seed_has_its_own_offsets_and_always_the_same(mixed: Network) -> None:
    drawn = [_offsets(mixed, seed) for seed in range(20)]
    assert set(drawn[0]) == {f"J{k}" for k in range(1, 10)}
    assert _offsets(mixed, 7) == drawn[7]
    for name in drawn[0]:
        times = [offsets[name] for offsets in drawn]
        assert min(times) < 20 and max(times) > 50 and all(0 <= time < 70 for time in times)


@pytest.mark.parametrize(("scenario", "coordinated"), [("green_wave", 7), ("mixed", 4), ("town", 0)])
def test_a_green_wave_is_shifted_as_a_whole_and_the_rest_signal_by_signal(
    scenario: str, coordinated: int, tmp_path: Path
) -> None:
    """Given two seeds, then the signals of the wave are shifted by one and the same time, the others are not."""
    network = build(files.load(scenario), tmp_path)
    one, other = _offsets(network, 1), _offsets(network, 2)
    shifts = [(other[name] - one[name]) % 70 for name in network.coordinated]
    assert len(shifts) == coordinated
    # Whole seconds: rounding may differ by one.
    assert all((shift - shifts[0] + 1) % 70 <= 2 for shift in shifts)
    alone = [(other[name] - one[name]) % 70 for name in one if name not in network.coordinated]
    assert len(alone) == 9 - coordinated and (len(alone) < 2 or len(set(alone)) > 1)


def test_sumo_starts_its_programmes_there(tmp_path: Path) -> None:
    """Given an offset, then SUMO's signal shows at that second what it shows at 0 without one."""
    import libsumo

    from sim.demand import demand
    from sim.traffic import Traffic

    town = files.load("town")
    town = town.model_copy(update={"traffic": town.traffic.model_copy(update={"vehicles": 0})})
    network = build(town, tmp_path)
    routes, signals = tmp_path / "routes.xml", tmp_path / "signals.xml"
    routes.write_text(demand(town, network, 0, '<vType id="ego"/>', 10.0))
    signals.write_text(programmes(network, 3))
    shown = {}
    for name, additional in (("shifted", signals), ("plain", None)):
        with Traffic(network, routes, 0, additional):
            libsumo.simulation.step()
            shown[name] = []
            for _ in range(140):
                libsumo.simulation.step(float(len(shown[name]) + 1))
                shown[name].append(libsumo.trafficlight.getRedYellowGreenState("J3"))
    start = _offsets(network, 3)["J3"]
    assert start > 0
    assert shown["shifted"][start : start + 60] == shown["plain"][:60]
    assert shown["shifted"][:60] != shown["plain"][:60]
