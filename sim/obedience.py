"""How well advice is followed."""

import math
from collections import deque

from scenarios.schema import Scenario
from sim.advisor import Suggestion
from sim.traffic import PERIOD
from vehicle_model.car.randomness import generator


class Obedience:
    """How well advice is followed: heard late, missed a little, sometimes ignored; what is automatic only ignored."""

    def __init__(self, scenario: Scenario, seed: int, settings: dict[str, float], perfect: bool) -> None:
        driver = scenario.driver
        self._rng = generator(seed, "obedience")
        delay = 0.0 if perfect else driver.advice_delay + settings["driver_lag.extra_delay"]
        self._late: deque[Suggestion | None] = deque([None] * round(delay / PERIOD))
        self._error = 0.0 if perfect else driver.tracking_error
        refusal = 0.0 if perfect else max(driver.refusal, settings["driver_lag.ignored"])
        self._gain = 1.0 if perfect else settings["driver_lag.gain"]
        # Refusal comes in spells of 12 s on average.
        self._end_spell = PERIOD / 12.0
        self._begin_spell = self._end_spell * refusal / max(1.0 - refusal, 1e-9)
        self.refusing = False
        self._miss = 0.0
        self._last = 0.0

    def hear(self, suggestion: Suggestion | None) -> Suggestion | None:
        """Return the suggestion that he acts upon now, None if he does as he likes."""
        self._late.append(suggestion)
        heard = self._late.popleft()
        chance = self._rng.random()
        self.refusing = chance >= self._end_spell if self.refusing else chance < self._begin_spell
        if suggestion is not None and suggestion.automatic:
            heard = suggestion
        return None if self.refusing else heard

    def miss(self, acceleration: float) -> float:
        """Return what he makes of an advised acceleration (m/s2): correlated error over 2 s."""
        keep = math.exp(-PERIOD / 2.0)
        self._miss = keep * self._miss + math.sqrt(1.0 - keep * keep) * self._error * self._rng.standard_normal()
        return self._gain * acceleration + self._miss
