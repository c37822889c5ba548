"""Who else is on the road: journeys drawn so that the ego meets traffic, at a given mean number of vehicles."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenarios.schema import Scenario
from sim.graph import WayGraph, unwind, way_graph
from sim.net_file import NetFile, read
from sim.network import Network
from vehicle_model.car.randomness import generator

EGO = "ego"
EGO_DEPART = 5.0
"""s: the others have found their places by then."""
AWAY = 0.15
"""Weight of a journey that never meets the ego's road."""
CANDIDATES = 240
"""Journeys among which is drawn."""
SIGNAL_DELAY = 14.0
"""s that a signal costs on average: for the mean travel time only."""
CONGESTION = 1.12
"""Travel time over free flow, signals apart."""


@dataclass(frozen=True)
class Journey:
    """A way through the network that somebody may take."""

    edges: tuple[str, ...]
    times: NDArray[np.float64]
    """s: expected time at the end of each edge."""
    weight: float


def journeys(scenario: Scenario, network: Network, rng: np.random.Generator) -> list[Journey]:
    """Draw candidate journeys; those that share road with the ego weigh more."""
    net = read(network.net)
    graph = way_graph(net)
    ego = {graph.index[name] for name in network.edges}
    origins, weights = _origins(net, graph, network, rng)
    ends = _ends(net, graph, network, rng)
    times, before = graph.ways(origins)
    found: list[Journey] = []
    signals = _signal_arcs(net)
    for _ in range(6 * CANDIDATES):
        row = int(rng.choice(len(origins), p=weights / weights.sum()))
        end = int(rng.choice(ends))
        if not np.isfinite(times[row, end]) or end == origins[row]:
            continue
        way = unwind(before[row], int(origins[row]), end)
        length = graph.length[way].sum()
        if len(way) < 2 or length < 300.0:
            continue
        names = tuple(graph.names[i] for i in way)
        waits = np.array([SIGNAL_DELAY * ((a, b) in signals) for a, b in itertools.pairwise(names)] + [0.0])
        shared = sum(graph.length[i] for i in way if i in ego) / graph.length[list(ego)].sum()
        weight = (AWAY if shared == 0.0 else 1.0) + scenario.traffic.corridor * shared
        found.append(Journey(names, np.cumsum(graph.duration[way] * CONGESTION + waits), weight))
        if len(found) == CANDIDATES:
            break
    return found


def _signal_arcs(net: NetFile) -> set[tuple[str, str]]:
    return {pair for pair, links in net.links.items() if links[0].state in "oO"}


def _fringe(net: NetFile, graph: WayGraph) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Edges that nothing leads to, and edges that lead nowhere."""
    inward = np.asarray(graph.times.getnnz(axis=0)).ravel()
    outward = np.asarray(graph.times.getnnz(axis=1)).ravel()
    return np.flatnonzero((inward == 0) & (outward > 0)), np.flatnonzero((outward == 0) & (inward > 0))


def _origins(
    net: NetFile, graph: WayGraph, network: Network, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    inward, _ = _fringe(net, graph)
    inward = inward[graph.length[inward] > 25.0]
    if len(inward) < 8 or not network.source_weights:
        ego = np.array([graph.index[name] for name in network.edges])
        ego = ego[graph.length[ego] > 25.0]
        usable = np.flatnonzero(graph.length > 60.0)
        inward = np.unique(np.concatenate([rng.choice(usable, min(30, len(usable)), replace=False), ego]))
    weights = np.array([network.source_weights.get(graph.names[i], 1.0) for i in inward])
    return inward, weights


def _ends(net: NetFile, graph: WayGraph, network: Network, rng: np.random.Generator) -> NDArray[np.int64]:
    _, outward = _fringe(net, graph)
    if len(outward) < 8 or not network.source_weights:
        usable = np.flatnonzero(graph.length > 60.0)
        ego = np.array([graph.index[name] for name in network.edges[1:]])
        outward = np.concatenate([rng.choice(usable, min(40, len(usable)), replace=False), ego])
    return outward


def demand(scenario: Scenario, network: Network, seed: int, ego_type: str, horizon: float) -> str:
    """Return SUMO's route file: the ego, those under way at the start and those who set out until `horizon` (s).

    `ego_type` is the XML of the vType named `ego`. By Little's law the rate is number / mean travel time, so that
    the mean number in the network is `scenario.traffic.vehicles`.
    """
    traffic = scenario.traffic
    rng = generator(seed, "traffic")
    pool = journeys(scenario, network, rng) if traffic.vehicles else []
    lines = [_vehicle(EGO, "ego", EGO_DEPART, network.edges, f'departPos="{network.depart:.3f}" departSpeed="0"')]
    starts = [EGO_DEPART]
    if pool:
        weight = np.array([journey.weight for journey in pool])
        duration = np.array([journey.times[-1] for journey in pool])
        under_way = weight * duration / (weight * duration).sum()
        for k in range(traffic.vehicles):
            journey = pool[int(rng.choice(len(pool), p=under_way))]
            first = int(np.searchsorted(journey.times, rng.uniform(0.0, journey.times[-1])))
            rest = journey.edges[min(first, len(journey.edges) - 1) :]
            lines.append(
                _vehicle(f"w{k}", _kind(rng, traffic.trucks), 0.0, rest, 'departPos="random_free" departSpeed="max"')
            )
            starts.append(0.0)
        rate = traffic.vehicles / float((weight * duration).sum() / weight.sum())
        at, k = 0.0, 0
        while (at := at + float(rng.exponential(1.0 / rate))) < horizon:
            journey = pool[int(rng.choice(len(pool), p=weight / weight.sum()))]
            kind = _kind(rng, traffic.trucks)
            lines.append(_vehicle(f"t{k}", kind, at, journey.edges, 'departSpeed="max"'))
            starts.append(at)
            k += 1
    ordered = [lines[i] for i in np.argsort(starts, kind="stable")]
    model = f'carFollowModel="{traffic.model}"'
    sigma = f' sigma="{traffic.imperfection:g}"' if traffic.model == "Krauss" else ""
    spread = traffic.speed_spread
    types = [
        f'<vType id="car" length="4.4" minGap="2.3" accel="2.0" decel="3.5" tau="1.1" maxSpeed="50" {model}{sigma} '
        f'speedFactor="normc(0.98,{spread:g},0.7,1.2)"/>',
        f'<vType id="truck" vClass="truck" length="11" minGap="2.8" accel="0.9" decel="3.0" tau="1.4" maxSpeed="25" '
        f'{model}{sigma} speedFactor="normc(0.95,{spread / 2:g},0.7,1.1)"/>',
        ego_type,
    ]
    return "<routes>\n" + "\n".join([*types, *ordered]) + "\n</routes>\n"


def _kind(rng: np.random.Generator, trucks: float) -> str:
    return "truck" if rng.random() < trucks else "car"


def _vehicle(name: str, kind: str, depart: float, edges: Sequence[str], more: str) -> str:
    return (
        f'<vehicle id="{name}" type="{kind}" depart="{depart:.1f}" departLane="best" {more}>'
        f'<route edges="{" ".join(edges)}"/></vehicle>'
    )
