"""The Pontryagin advisor: the whole road planned once, the next few hundred metres again every second.

At each replanning the problem of `controller.route` is solved from the car's own place, speed and gear to the horizon,
on the table of the map made beforehand:
- free road: to the speed of the whole road's plan at the horizon, so that both agree where nothing interferes;
- a signal that does not tell when it turns, or a standing leader: to the line, the speed left free; time is cheap,
  since it would be waited off there, and so is kinetic energy, since most of it would be braked away;
- a signal that tells when it turns: as on a free road, but hurried where that saves a stop, and slower from afar
  where it would still be red (`sim.signal_timing`);
- a slower leader: to his speed at the place where he would be caught up with; time is cheap, since he sets it.
What is said is said for when it will be acted upon, and a person who acts late is left alone with what he does better
by himself: to keep his distance to the car in front, to brake for what he sees, and, if he does it well, to shift.
Between two replannings the policy around the plan answers for whatever speed the car really has.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from controller.advice import Advice, RoadAhead
from controller.drive_table import DriveTable, drive_table
from controller.route import Comfort, plan_route
from sim.advisor import COAST, HIS_OWN, Context, Suggestion, View, keeps_his_distance
from sim.signal_timing import ABOVE, SETTLE, Timing, slower, timing
from vehicle_model.car.errors import BadInput

WHOLE_STEP, NODES = 10.0, 300
"""m between the places of the whole road's plan, and speeds of both plans' grid."""
PERIOD = 1.0
"""s between two plans."""
STEP, STAGES = 5.0, 50
"""m between the places of the plan in hand at least, and stages at most: finer where it is slow, since a step that is
long for the speed spreads the slowness of a corner and a launch over all of it."""
LASTS = 5.0
"""s of driving that a plan's policy covers: until the next plan, and what a person does late."""
PRESSING = 0.4
"""s more that a person takes to press the pedal than to lift the foot."""
MOMENT = 0.5
"""s over which the box's speed is differenced: what the car does now, which it goes on doing until he acts."""
FORESIGHT = 20.0
"""s of driving that the horizon holds."""
HORIZON = (250.0, 600.0)
"""m that it holds at least and at most: what it takes to stop, or to reach a limit."""
SHORTEST = 30.0
"""m: nearer ends are left to the driver."""
REACH = 200.0
"""m within which a leader counts."""
WAITED_OFF = 0.25
"""Share of the price of time that holds where the time gained would be waited off; less what idling there burns."""
CATCH_UP = 1.5
"""s within which the speed of a leader close by is taken on."""
GREEN = 40.0
"""s that a green or red phase lasts, about: every second later at a green light is a chance of 1 / `GREEN` that it
turns, which costs as long a wait, idling, and the speed."""
KEPT = 0.3
"""Share of the kinetic energy at a red signal's line that counts: it may turn green in time."""
COMFORT = Comfort()
HURRY = 6.0
"""Times the price of time that a second is worth while it decides over a green light that is about to end."""
NEVER = (-math.inf, -math.inf)
"""No place, no time at which to be at a line."""
ROLLS = 1.3
"""Times the rule of thumb for rolling that is still done by rolling."""
ROLLING = 60.0
"""N of planned braking below which the advice is to let it roll."""


@dataclass
class RecedingHorizon:
    """Replans every second; see the module. `step` m and `nodes` (speeds) set the grid of the whole road's plan."""

    context: Context
    step: float = WHOLE_STEP
    nodes: int = NODES
    _whole: Advice | None = field(default=None, init=False, repr=False)

    def reset(self) -> None:
        """Plan the whole road. Raises BadInput for a road that cannot be driven."""
        c = self.context
        fastest = 1.02 * float(c.road.speed_max.max()) + 1.0
        self._table: DriveTable = drive_table(c.fuel_map, c.car, speed_top=fastest, nodes=self.nodes)
        self._whole = plan_route(
            c.road, c.fuel_map, c.car, start_speed=c.start_speed, end_speed=c.end_speed, time_value=c.time_value,
            step=self.step, table=self._table, policy_step=self.step, certify=False,
        )  # fmt: skip
        self._plan = self._whole
        self._due = -math.inf
        self._silent = False
        self._pace = math.inf
        self._arrival = NEVER
        self._rolling = False
        self._leader: tuple[float, float] = (-math.inf, math.nan)
        self._trend, self._before = 0.0, (-math.inf, 0.0)

    def advise(self, view: View) -> Suggestion | None:
        """The action of the plan in force; silent before `Context.begin`."""
        self._feel(view)
        if view.distance < self.context.begin:
            return None
        if view.time >= self._due - 1e-9:
            self._plan = self._replanned(view)
            self._due = view.time + PERIOD
        if self._silent:
            return None
        plan = self._plan
        # What is said now is done a moment later: it is said for where, and how fast, he will be by then.
        # More takes longer than less: the foot has to come down.
        place, speed = self._when_done(view, self.context.delay)
        acceleration, gear, costate = plan.action(place, speed)
        if self.context.delay > 0.0:
            later = plan.action(*self._when_done(view, self.context.delay + PRESSING))
            acceleration, gear = max((acceleration, gear), later[:2])
        gear = gear if self.context.tells_gears else 0
        acceleration = min(acceleration, (self._pace - view.speed) / CATCH_UP)
        # Where the grid or a leader's change of speed asks for more than was planned, the driver's own eyes do.
        acceleration = max(acceleration, -COMFORT.braking)
        held = self._held(view)
        if held is not None and held[0] < acceleration:
            acceleration, rolls = held
            gear = gear if rolls or not self.context.tells_gears else self._steady_gear(view)
            return Suggestion(acceleration, gear, costate, coast=rolls)
        late = self.context.delay > 0.0  # who acts at once is better told all of it
        if late and keeps_his_distance(view, acceleration):
            # Who follows a car gains no time by haste: he keeps his distance himself, and better than by arrows.
            return Suggestion(0.0, self._steady_gear(view), costate, free=True) if self.context.tells_gears else None
        if late and acceleration < -HIS_OWN:
            return None  # what there is to brake for is there to be seen, and he does it without delay
        k = min(max(int(np.searchsorted(plan.s, place, side="right")) - 1, 0), len(plan.s) - 1)
        near = abs(plan.speed[k] - speed) < 1.0
        rolls = near and bool(plan.coasting[k]) and plan.brake_force[k] < ROLLING and acceleration < 0.0
        return Suggestion(acceleration, gear, costate, coast=rolls)

    def _feel(self, view: View) -> None:
        """Follow the car's acceleration (m/s2) by the box's speed."""
        before, speed = self._before
        passed = view.time - before
        if 0.0 < passed < MOMENT:
            self._trend += min(passed / MOMENT, 1.0) * ((view.speed - speed) / passed - self._trend)
        self._before = view.time, view.speed

    def _when_done(self, view: View, delay: float) -> tuple[float, float]:
        """Place (m) and speed (m/s) at which he will act upon what is said now, `delay` s later."""
        speed = max(view.speed + self._trend * delay, 0.0)
        return view.distance + 0.5 * (view.speed + speed) * delay, speed

    def _replanned(self, view: View) -> Advice:
        """The plan from here, or the whole road's where there is nothing left to plan or no way to do it."""
        assert self._whole is not None, "reset comes first"
        told = timing(view, self._plan, self._whole, self.context.road)
        self._arrival = NEVER
        arrival = told.arrival if told is not None else None
        if arrival is not None:
            if slower(view.speed, view.told_distance, arrival) is None:
                told = None  # not without creeping: a red signal like any other
            else:
                self._arrival = view.distance + view.told_distance, view.time + arrival
        reach, end_speed, waiting = self._obstacle(view, told)
        # The last metres to a line or a standing car are the driver's; behind a moving one, his speed is held.
        self._silent = waiting and end_speed is None and reach < SHORTEST
        self._pace = end_speed if end_speed is not None and reach < SHORTEST else math.inf
        price = self.context.time_value
        if told is not None and told.hurry and not waiting:
            price *= HURRY
        elif view.signal_state == "green" and told is None and not waiting:
            price += price + self.context.fuel_map.idle_power
            price += 0.5 * self.context.car.accelerated_mass * view.speed**2 * self._table.marginal_cost / GREEN
        if waiting:
            price = max(WAITED_OFF * price - self.context.fuel_map.idle_power, 0.0)
        horizon = min(max(FORESIGHT * view.speed, HORIZON[0]), HORIZON[1])
        road = self._ahead(view.distance, min(reach, horizon), courteous=not waiting)
        if road is None:
            return self._whole
        credit = KEPT * self._table.marginal_cost if waiting else None
        if not waiting:
            end_speed = float(np.interp(road.s[-1], self._whole.s, self._whole.speed))
        try:
            return self._solve(road, view, price, end_speed, credit)
        except BadInput:  # that speed cannot be had there: leave it free
            try:
                return self._solve(road, view, price, None, credit)
            except BadInput:
                return self._whole

    def _solve(
        self, road: RoadAhead, view: View, price: float, end_speed: float | None, credit: float | None
    ) -> Advice:
        c = self.context
        top = math.sqrt(self._table.energy_step * (self._table.nodes - 1) * 2.0)
        step = max((road.s[-1] - road.s[0]) / STAGES, STEP)
        if end_speed is not None:
            end_speed = min(end_speed, max(float(road.speed_max[-1]), 1.0))
        return plan_route(
            road, c.fuel_map, c.car, start_speed=min(view.speed, top), end_speed=end_speed, time_value=price,
            start_gear=view.gear or None, end_price=credit, step=step, table=self._table,
            policy_step=step, policy_reach=LASTS * max(view.speed, 5.0), certify=False,
        )  # fmt: skip

    def _held(self, view: View) -> tuple[float, bool] | None:
        """Acceleration (m/s2) and whether to roll, to be at the line when it is green; None: no reason to wait."""
        line, at = self._arrival
        if view.distance >= line or view.time >= at:
            return None
        found = slower(view.speed, line - view.distance, at - view.time)
        if found is None:
            return None
        target, braking = found
        self._rolling = view.speed - target > (0.0 if self._rolling else ABOVE)
        if self._rolling:
            return -braking, braking < ROLLS * COAST
        return min((target - view.speed) / SETTLE, COMFORT.acceleration), False

    def _steady_gear(self, view: View) -> int:
        """The gear that burns least at this speed, held, on the map in use; 0 where none can."""
        table, car = self._table, self.context.car
        row = min(round(view.speed**2 / table.energy_step), table.fuel.shape[1] - 1)
        pitch = float(np.interp(view.distance, self.context.road.s, self.context.road.pitch))
        load = car.mass * car.gravity * (math.sin(pitch) + car.rolling_resistance * math.cos(pitch))
        load += 0.5 * car.air_density * car.drag_area * view.speed**2
        low, high = table.force_low[:, row], table.force_high[:, row]
        level = (load - low) / np.where(high > low, high - low, 1.0) * (table.fuel.shape[2] - 1)
        usable = (high > low) & (level >= 0.0) & (level < table.fuel.shape[2])
        if not usable.any():
            return 0
        burnt = [np.interp(x, np.arange(table.fuel.shape[2]), table.fuel[g, row]) for g, x in enumerate(level)]
        return int(np.argmin(np.where(usable, burnt, np.inf))) + 1

    def _obstacle(self, view: View, told: Timing | None) -> tuple[float, float | None, bool]:
        """How far the way is free (m), the speed to arrive there with (None: free), whether time is waited off."""
        reach, end_speed, waiting = math.inf, None, False
        if view.signal_state in ("red", "yellow") and told is None:
            reach, waiting = view.signal_distance, True
        leader = self._leader_speed_soon(view)
        closing = view.speed - leader
        if view.leader_gap < min(REACH, reach) and closing > 0.5:
            if leader < 1.0:
                return view.leader_gap, None, True
            # Caught up with at the mean of both speeds; 1.2 s behind him is where one wants to be.
            room = max(view.leader_gap - 1.2 * leader, 0.0)
            caught = room / (0.5 * closing) * 0.5 * (view.speed + leader)
            if caught < min(2.0 * REACH, reach):
                reach, end_speed, waiting = caught, leader, True
        return reach, end_speed, waiting

    def _leader_speed_soon(self, view: View) -> float:
        """Leader's speed in 2 s if he goes on as in the last second (nan without one)."""
        before_time, before = self._leader
        self._leader = (view.time, view.leader_speed)
        passed = view.time - before_time
        if not (math.isfinite(before) and math.isfinite(view.leader_speed) and 0.0 < passed < 2.0):
            return view.leader_speed
        trend = float(np.clip((view.leader_speed - before) / passed, -2.0, 2.0))
        return max(view.leader_speed + 2.0 * trend, 0.0)

    def _ahead(self, place: float, reach: float, *, courteous: bool) -> RoadAhead | None:
        """The road from `place` for `reach` m; None where that is too short to plan."""
        road = self.context.road
        first = max(int(np.searchsorted(road.s, place, side="right")) - 1, 0)
        last = int(np.searchsorted(road.s, place + reach, side="right"))
        if min(reach, road.s[-1] - place) < SHORTEST or last - first < 3:
            return None
        cut = slice(first, last)
        piece = RoadAhead(road.s[cut], road.pitch[cut], road.speed_max[cut], road.speed_min[cut])
        return piece if courteous else replace(piece, speed_min=np.zeros(last - first))
