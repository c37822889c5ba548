"""The plant and the reader of its logger's card, each beside its readable reference."""

from functools import cache

import numpy as np

from benchmarks.timing import Row, least, row
from sensors import packet_reference
from sensors.box import record
from sensors.packets import decode
from vehicle_model.car.files import read_car
from vehicle_model.plant import kernel, reference
from vehicle_model.plant.cycle import read_cycle, run_cycle
from vehicle_model.plant.parameters import plant_parameters

STEP = 0.01
"""s."""
SHARE = 20
"""The readable reader gets this share (one in ...) of the card: it takes a thousand times longer."""


def plant(repeats: int = 5) -> list[Row]:
    """The Smart over UDDS, every 10 ms recorded; reference: the same equations in readable Python, 10 s of driving."""
    car, cycle = read_car("smart"), read_cycle("UDDS")
    run_cycle(car, cycle)
    value = float(cycle.time[-1]) / least(lambda: run_cycle(car, cycle), repeats)
    p = plant_parameters(car, {})
    named = reference.parameters_by_name(p)
    start = np.zeros(kernel.STATES)
    kernel.initial_state(p, start, 12.0, 3.0)
    seconds = 10.0

    def readable() -> None:
        state = reference.State.of(start)
        for _ in range(round(seconds / STEP)):
            reference.step(named, state, 600.0, 3.0, 0.0, 0.0, 0.0, 0.0, STEP)

    return [row("plant", value, "x_real_time", "readable Python", seconds / least(readable, 3))]


def packet_read(repeats: int = 7) -> list[Row]:
    """The card of 23 minutes, from bytes to streams; reference: plain Python that only finds where packets begin."""
    card = a_card()
    decode(card)
    part = card[: len(card) // SHARE]
    value = len(card) / 1e6 / least(lambda: decode(card), repeats)
    readable = len(part) / 1e6 / least(lambda: packet_reference.scan(part), 2)
    return [row("packet_read", value, "MB/s", "plain Python, framing alone", readable)]


@cache
def a_card() -> bytes:
    """What the logger writes during UDDS."""
    car = read_car("smart")
    trip, _ = run_cycle(car, "UDDS")
    return record(trip, car)


BENCHMARKS = {"plant": plant, "packet_read": packet_read}
"""Name of `rollingroad bench` -> the function that measures it."""
