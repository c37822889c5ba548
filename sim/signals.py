"""When the signals turn: every seed its own, so that seeds are independent samples of what a driver meets."""

from xml.sax.saxutils import quoteattr

from sim.net_file import read
from sim.network import Network
from vehicle_model.car.randomness import generator


def programmes(network: Network, seed: int) -> str:
    """Return SUMO's additional file with the offset of every signal under `seed`.

    Coordinated signals keep their offsets to each other: all are shifted by one time. The others are shifted each by
    itself. Whole seconds within a cycle.
    """
    rng = generator(seed, "signals")
    common = rng.random()
    rows = []
    for name, programme in sorted(read(network.net).signals.items()):
        alone = rng.random()  # drawn for all, so that coordinating one changes no other
        share = common if name in network.coordinated else alone
        offset = network.coordinated.get(name, 0.0) + share * programme.cycle
        start = int(offset % programme.cycle)
        rows.append(f'  <tlLogic id={quoteattr(name)} programID={quoteattr(programme.id)} offset="{start}"/>\n')
    return f"<additional>\n{''.join(rows)}</additional>\n"
