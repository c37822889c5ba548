"""Ways through a network: the graph whose nodes are edges and whose arcs are the allowed connections."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from sim.net_file import NetFile

TURN_PENALTY = {"s": 0.0, "r": 4.0, "R": 2.0, "l": 8.0, "L": 3.0, "t": 60.0}
"""s that a manoeuvre costs when choosing a way."""


@dataclass(frozen=True)
class WayGraph:
    """Edges by index, and the sparse matrix of travel times between consecutive ones."""

    names: tuple[str, ...]
    index: dict[str, int]
    times: csr_matrix
    duration: NDArray[np.float64]
    """(n,), s: free-flow time on each edge."""
    length: NDArray[np.float64]

    def ways(self, origins: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Travel time from the start of each origin edge to the start of every edge, and predecessors."""
        times, before = dijkstra(self.times, indices=origins, return_predecessors=True)
        return times, before

    def largest_component(self) -> NDArray[np.bool_]:
        """Edges of the largest strongly connected part."""
        _, label = connected_components(self.times, connection="strong")
        return label == np.bincount(label).argmax()


def way_graph(net: NetFile) -> WayGraph:
    """Build the graph: cost of an arc = time on the edge left behind + the penalty of the turn."""
    names = tuple(net.edges)
    index = {name: i for i, name in enumerate(names)}
    duration = np.array([edge.length / edge.speed for edge in net.edges.values()])
    rows, columns, costs = [], [], []
    for (a, b), links in net.links.items():
        if links[0].direction == "t":
            continue
        rows.append(index[a])
        columns.append(index[b])
        costs.append(duration[index[a]] + min(TURN_PENALTY.get(link.direction, 0.0) for link in links))
    n = len(names)
    length = np.array([edge.length for edge in net.edges.values()])
    return WayGraph(names, index, csr_matrix((costs, (rows, columns)), shape=(n, n)), duration, length)


def unwind(before: NDArray[np.int32], origin: int, end: int) -> list[int]:
    """Follow one row of predecessors back from `end` to `origin`; empty if it is not reached."""
    way = [end]
    while way[-1] != origin:
        previous = int(before[way[-1]])
        if previous < 0:
            return []
        way.append(previous)
    return way[::-1]
