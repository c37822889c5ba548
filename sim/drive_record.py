"""What a drive was and what it took: counted step by step, and kept."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim.caution import WALKING
from sim.display import Display
from sim.traffic import PERIOD, Traffic
from vehicle_model.car.route import Route
from vehicle_model.car.trip import Trip
from vehicle_model.plant.session import Plant

OVER_LIMIT = 3.0 / 3.6
"""m/s above the limit that counts as a violation."""
HARSH = 3.5
"""m/s2 of braking that counts as harsh."""
HASHED = 3_000
"""Steps after the first advice whose traffic is still hashed: that takes as long as driver and car together."""


@dataclass(frozen=True)
class Compliance:
    """What became of the advice, measured; all nan in a drive without any."""

    followed_share: float
    """Share of the time with advice in which it, and neither refusal nor traffic, set what was done."""
    refused_share: float
    """Share of the time with advice in which he did as he liked."""
    missed_rms: float
    """m/s2 between advised and true acceleration while it was followed, gear changes included."""
    changes_per_minute: float
    """How often arrow (up, hold, down) or gear of the display change: what there is to look at. See 5.1.3."""
    eyes_off_road_share: float = math.nan
    """Share of the time with advice in which he looks at the display, his foot as it was."""


@dataclass(frozen=True)
class Drive:
    """A drive and what it took."""

    trip: Trip
    route: Route
    vehicles: float
    """Mean number of vehicles in the network while the ego drove."""
    step_hashes: tuple[int, ...]
    """One per step of SUMO over all vehicles: equal hashes, equal traffic. Up to `HASHED` steps after the first
    advice: what it changed is no longer compared."""
    first_advice_step: int | None
    """Step at which advice first reached the driver."""
    advised_share: float
    """Share of the steps in which advice, not traffic or refusal, set the wish."""
    costate: NDArray[np.float64]
    """Costate shown at each step (J per m/s, nan where none was)."""
    min_time_to_collision: float
    """s: bumper to bumper over the speed of closing in, the least over all steps with a leader in sight who is being
    caught up with by more than walking pace (1.4 m/s); inf where there were none."""
    limit_violations: int
    """Times the limit was exceeded by more than 3 km/h."""
    harsh_braking: int
    """Times it was braked harder than 3.5 m/s2."""
    parked_s: float
    """s at rest before setting out and after arriving: not part of the trip's time."""
    arrived: bool
    collisions: int
    red_lights_run: int
    simulated_s: float
    """s that SUMO simulated."""
    wall_s: float
    """s that it took."""
    notes: tuple[str, ...] = ()
    compliance: Compliance = Compliance(math.nan, math.nan, math.nan, math.nan)
    owed_fuel: float = 0.0
    """J that accessories which were scheduled still cost after the trip; to be added to its fuel."""


@dataclass
class Tally:
    """What is counted during a drive."""

    steps: int = 0
    hashes: list[int] = field(default_factory=list)
    costates: list[float] = field(default_factory=list)
    vehicles: int = 0
    advised: int = 0
    told: int = 0
    refused: int = 0
    missed: float = 0.0
    looking: int = 0
    first_advice: int | None = None
    min_ttc: float = math.inf
    over: bool = False
    violations: int = 0
    harsh: bool = False
    harsh_times: int = 0
    collisions: int = 0
    red_run: int = 0


def complied(tally: Tally, display: Display | None) -> Compliance:
    if not tally.told:
        return Drive.compliance
    return Compliance(
        followed_share=tally.advised / tally.told,
        refused_share=tally.refused / tally.told,
        missed_rms=math.sqrt(tally.missed / tally.advised) if tally.advised else math.nan,
        changes_per_minute=display.changes / (tally.told * PERIOD / 60.0) if display is not None else math.nan,
        eyes_off_road_share=tally.looking / tally.told,
    )


def count_step(
    tally: Tally,
    traffic: Traffic,
    plant: Plant,
    limit: float,
    gap: float,
    leader_speed: float,
    signal_before: tuple[float, str],
) -> None:
    if tally.first_advice is None or tally.steps < tally.first_advice + HASHED:
        tally.hashes.append(traffic.state_hash())
    tally.steps += 1
    tally.vehicles += traffic.vehicles()
    closing = plant.speed - leader_speed
    if gap < math.inf and closing > WALKING:
        tally.min_ttc = min(tally.min_ttc, (gap + 2.0) / closing)
    over = plant.speed > limit + OVER_LIMIT
    tally.violations += over and not tally.over
    tally.over = over
    harsh = plant.acceleration < -HARSH
    tally.harsh_times += harsh and not tally.harsh
    tally.harsh = harsh
    tally.collisions += traffic.ego_collided()
    distance, state = signal_before
    tally.red_run += state in ("r", "u") and distance < -0.5 and plant.speed > 0.5
