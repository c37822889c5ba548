"""The family of seed 004, appendix A, behind one interface: each filter observes a log, instant by instant.

`FAMILY` names them. They share one model, one noise, one gate and one start, so that what sets them apart is how they
filter. They are the readable forms: references and subjects of comparison. The observer to use is `observer.observe`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from scipy.linalg import expm

from observer import kalman, model, particle, square_root, unscented
from observer.instants import WIDTH, Instant
from observer.normal_form import KINDS as NORMAL_KINDS
from observer.normal_form import SLOWEST, AdaptiveHighGain
from observer.system import Array, Reading, System, car_reading, car_system
from observer.thrust_models import thrust_system, widened
from vehicle_model.car.parameters import Car

NOISE = np.array(
    [1e-6, 1e-5, 3e5, 1e-6, 1e-6, 1e-3, 1e-3, 1e-4, 4e-5, 1e-8, 1.0, 1e9, 1e-6, 50.0, 1e-8, 1e-8, 1e-8]
)  # fmt: skip
"""Densities of the 17 states: a thrust that wanders, whatever the fuel does."""
SPREAD = np.array([1.0, 3.0, 500, 3.0, 0.04, 5, 5, 8, 0.01, 3e-4, 1e2, 1e4, 1.0, 30, 0.3, 0.3, 0.3])
"""Deviations at the start."""
WANDERING = {1: 3e7, 2: 1e10}
"""Noise density of the highest derivative of the thrust, by order."""
GATE, REOPEN = 25.0, 3.0
"""Chi-square of one value beyond which it is turned away; s after which it enters all the same."""
PARTICLES = 500


class Filter(Protocol):
    """What an instant asks of a filter."""

    def predict(self, dt: float) -> None: ...
    def moments(self) -> tuple[Array, Array]:
        """Mean (17,) and covariance (17, 17)."""
        ...

    def correct(self, reading: Reading, instant: Instant) -> None: ...


@dataclass
class Gaussian:
    """A filter that is two functions on (state, covariance or its factor)."""

    state: Array
    second: Array
    step: Callable[[Array, Array, float], tuple[Array, Array]]
    fuse: Callable[[Array, Array, Reading], tuple[Array, Array]]
    factored: bool = False
    order: int = 0

    def predict(self, dt: float) -> None:
        self.state, self.second = self.step(self.state, self.second, dt)

    def moments(self) -> tuple[Array, Array]:
        P = self.second @ self.second.T if self.factored else self.second
        return self.state[:17], P[:17, :17]

    def correct(self, reading: Reading, instant: Instant) -> None:
        self.state, self.second = self.fuse(self.state, self.second, widened(reading, self.order))


class Continuous:
    """CC-EKF: readings act all through the instant, with a density R dt.

    A gain P H' / R that settles within a step cannot be integrated by it: R is taken no smaller than that.
    """

    def __init__(self, car: Car, x: Array, deviation: Array, step: float = 0.05) -> None:
        self._system, self._step = car_system(car, NOISE), step
        self.x, self.P = x, np.diag(deviation**2)
        self._dt = 0.0

    def predict(self, dt: float) -> None:
        self._dt = dt

    def moments(self) -> tuple[Array, Array]:
        return self.x, self.P

    def correct(self, reading: Reading, instant: Instant) -> None:
        h = reading.jacobian(self.x)
        least = 2.0 * self._step * np.einsum("ij,jk,ik->i", h, self.P, h)
        floor = np.diag(np.maximum(np.diag(reading.noise) * self._dt, least))
        density = Reading(reading.value, reading.expected, reading.jacobian, floor, reading.angles)
        begin, end = 0.0, self._dt
        self.x, self.P = kalman.integrate_continuous(
            self._system, self.x, self.P, lambda t: density, begin, end, self._step
        )


class HighGain:
    """The adaptive high-gain EKF; its outputs are those of the normal form, and it wants a car that moves.

    Distance and fuel energy are outputs where others take their rates: sums of the increments, counted anew from the
    state after a hole. Fixes and courses are brought forward by their lag. The normal form ends where the wheels fall
    silent: the state is held, and the filter begins anew from it.
    """

    UNGATED = (model.SPEED, model.FUEL_POWER, model.ACCELERATION_X)
    """A gate would turn away the very innovations that are to raise the gain."""
    STEPS = 4
    """Of an instant: at a high gain and a walk the form is stiff, and a covariance would turn negative."""
    THRESHOLD = (30.0, 100.0)
    """Misfit J_d below which the gain falls and above which it rises: usual driving stays under the second."""

    def __init__(self, car: Car, x: Array, deviation: Array) -> None:
        self._car, self._deviation = car, deviation.copy()
        self._begin(x)
        self._asleep = True
        self._dt = 0.0

    def _begin(self, x: Array) -> None:
        moving = x.copy()
        moving[model.V] = max(moving[model.V], 2.0 * SLOWEST)
        self._filter = AdaptiveHighGain(self._car, moving, np.diag(self._deviation**2), NOISE, threshold=self.THRESHOLD)
        self._sums: dict[int, float] = {}

    def turn(self, course: float) -> None:
        self._filter.z[3] = course
        self._deviation[model.PSI] = 0.1

    def predict(self, dt: float) -> None:
        self._dt = dt
        for _ in range(0 if self._asleep else self.STEPS):
            self._filter.predict(dt / self.STEPS)

    def moments(self) -> tuple[Array, Array]:
        found = self._filter
        back = np.linalg.inv(found._push(found.z))
        return found.state(), back @ found.covariance @ back.T

    def correct(self, reading: Reading, instant: Instant) -> None:
        told = dict(zip(instant.kinds, reading.value.tolist(), strict=True))
        if told.get(model.SPEED, 0.0) < 2.0 * SLOWEST:
            self._asleep = self._asleep or model.SILENT_WHEELS in told
        elif self._asleep:
            x = self._filter.state()
            x[model.V] = told[model.SPEED]
            self._begin(x)
            self._asleep = False
        if self._asleep:
            return
        z = self._filter.z
        for kind, value, variance, aux in zip(
            instant.kinds, reading.value, np.diag(reading.noise), instant.aux, strict=True
        ):
            if kind in self.SUMS:
                self._count(kind, float(value), float(variance))
            elif kind in model.HEADINGS:
                nu = float(value) + aux * z[4] - z[3]
                near = z[3] + (nu + np.pi) % (2.0 * np.pi) - np.pi
                self._filter.correct(model.MAP_HEADING, float(near), float(variance))
            elif kind in NORMAL_KINDS:
                x = self._filter.state()
                late = model.measurement(kind, x, self._car, float(aux)) - model.measurement(kind, x, self._car)
                self._filter.correct(kind, float(value - late), float(variance))
        for kind in self.SUMS:
            if kind not in told:
                self._sums.pop(kind, None)

    SUMS: ClassVar = {model.SPEED: model.DISTANCE, model.FUEL_POWER: model.INJECTED_ENERGY}
    """Rates that are measured, and the output that their sum is."""

    def _count(self, kind: int, rate: float, variance: float) -> None:
        """Add an increment to the sum that is the output; the first one only sets its zero."""
        output = self.SUMS[kind]
        place = NORMAL_KINDS[output]
        if kind not in self._sums:
            self._sums[kind] = float(self._filter.z[place])
            return
        self._sums[kind] += rate * self._dt
        self._filter.correct(output, self._sums[kind], variance * self._dt**2)


class Bootstrap:
    """The particle filter on the reduced model; what it does not hold stands still at what was last measured."""

    def __init__(self, car: Car, x: Array, deviation: Array) -> None:
        self._car, self._rng = car, np.random.default_rng(0)
        keep = list(particle.REDUCED)
        self._cloud = particle.draw(x[keep], np.diag(deviation[keep] ** 2), PARTICLES, self._rng)
        self._x, self._P = x.copy(), np.diag(deviation**2)

    def predict(self, dt: float) -> None:
        particle.predict(self._cloud, self._car, NOISE[list(particle.REDUCED)], dt, self._rng)

    def moments(self) -> tuple[Array, Array]:
        keep = list(particle.REDUCED)
        x, P = self._x.copy(), self._P.copy()
        x[keep], P[np.ix_(keep, keep)] = self._cloud.mean(), self._cloud.covariance()
        return x, P

    def correct(self, reading: Reading, instant: Instant) -> None:
        for kind, value, variance, aux in zip(
            instant.kinds, reading.value, np.diag(reading.noise), instant.aux, strict=True
        ):
            if kind == model.FUEL_POWER:
                self._x[model.PIN] = value
            if kind in (model.ACCELERATION_X, model.SPEED, model.SILENT_WHEELS, model.GPS_SPEED):

                def told(full: Array, kind: int = kind, aux: float = aux) -> Array:
                    return np.asarray(model.measurement(kind, full, self._car, aux, np))  # type: ignore[arg-type]

                # far fewer particles than a sharp likelihood wants: blunt it
                blunt = max(float(np.sqrt(variance)), 0.05)
                particle.correct(self._cloud, told, float(value), blunt, self._rng)


LINEAR_SPEED = 15.0
"""m/s about which the linear filters take the model."""


def _linear(car: Car) -> tuple[System, Array]:
    """The 17-state model as a line about a level road at `LINEAR_SPEED`: its system, and a point on it."""
    x0 = np.zeros(17)
    x0[model.V] = LINEAR_SPEED
    a, rate = model.dynamics_jacobian(x0, car), np.array(model.dynamics(x0, car))
    return System(lambda x: (a @ x.T).T + rate - a @ x0 if x.ndim == 1 else a @ x + (rate - a @ x0)[:, None],
                  lambda x: a, np.diag(NOISE)), x0  # fmt: skip


class Luenberger:
    """A constant gain on (speed, acceleration): the stationary Kalman gain of the linear model, whatever happens."""

    KEPT = (model.V, model.F)

    def __init__(self, car: Car, x: Array, deviation: Array) -> None:
        self._system, self._x0 = _linear(car)
        keep = list(self.KEPT)
        a = self._system.jacobian(x)[np.ix_(keep, keep)]
        c = np.array([[1.0, 0.0], a[0]])
        self._gain = kalman.luenberger_gain(a, c, np.array([-3.0, -6.0]))
        self._c, self.x, self._dt = c, x.copy(), 0.0

    def predict(self, dt: float) -> None:
        self._dt = dt
        self.x = self.x + dt * self._system.dynamics(self.x)

    def moments(self) -> tuple[Array, Array]:
        return self.x, np.diag(SPREAD**2)

    def correct(self, reading: Reading, instant: Instant) -> None:
        keep = list(self.KEPT)
        nu = np.zeros(2)
        for kind, value in zip(instant.kinds, reading.value, strict=True):
            if kind in (model.SPEED, model.SILENT_WHEELS):
                nu[0] = value - self.x[model.V]
            elif kind == model.ACCELERATION_X:
                nu[1] = value - self._system.dynamics(self.x)[model.V]
            elif kind == model.FUEL_POWER:
                self.x[model.PIN] = value
        self.x[keep] = self.x[keep] + self._dt * self._gain @ nu


def _riding_on_a_line(car: Car, x: Array, deviation: Array) -> Filter:
    system, x0 = _linear(car)

    def fuse(state: Array, P: Array, reading: Reading) -> tuple[Array, Array]:
        h, told = reading.jacobian(x0), reading.expected(x0)
        line = Reading(reading.value, lambda s: told + h @ (s - x0), lambda s: h, reading.noise, reading.angles)
        return kalman.correct(state, P, line)

    phi = expm(system.jacobian(x) * WIDTH)

    def step(state: Array, P: Array, dt: float) -> tuple[Array, Array]:
        return state + dt * system.dynamics(state), phi @ P @ phi.T + system.noise * dt

    return Gaussian(x, np.diag(deviation**2), step, fuse)


def _extended(order: int) -> Callable[[Car, Array, Array], Filter]:
    def make(car: Car, x: Array, deviation: Array) -> Filter:
        noise = NOISE if order == 0 else np.where(np.arange(17) == model.F, 1e4, NOISE)
        system = thrust_system(car, noise, order, WANDERING.get(order, 0.0))
        wide = np.concatenate([x, np.zeros(order)])
        P = np.diag(np.concatenate([deviation**2, np.full(order, 1e6)]))
        return Gaussian(
            wide, P, lambda s, p, dt: kalman.predict_continuous(system, s, p, dt), kalman.correct, order=order
        )

    return make


def _discrete(car: Car, x: Array, deviation: Array) -> Filter:
    system = car_system(car, NOISE)
    return Gaussian(
        x, np.diag(deviation**2), lambda s, p, dt: kalman.predict_discrete(system, s, p, dt), kalman.correct
    )


def _square_root(car: Car, x: Array, deviation: Array) -> Filter:
    system, factor = car_system(car, NOISE), np.diag(np.sqrt(NOISE))
    return Gaussian(
        x,
        np.diag(deviation),
        lambda s, p, dt: square_root.predict(system, s, p, factor, dt),
        square_root.correct,
        factored=True,
    )


def _unscented(car: Car, x: Array, deviation: Array) -> Filter:
    system, spread = car_system(car, NOISE), unscented.Spread()
    return Gaussian(
        x,
        np.diag(deviation**2),
        lambda s, p, dt: unscented.predict(system, s, p, dt, spread),
        lambda s, p, reading: unscented.correct(s, p, reading, spread),
    )


def _kalman_bucy(car: Car, x: Array, deviation: Array) -> Filter:
    """Dynamics by A.29 without noise, then the noise by a factorisation.

    A.29 whole is stiff where noise is large against what is known: dS/dt = Q / (2 S) of a fuel power just measured.
    """
    quiet, spread = car_system(car, np.zeros(17)), unscented.Spread()
    noise = np.diag(np.sqrt(NOISE))

    def step(state: Array, S: Array, dt: float) -> tuple[Array, Array]:
        state, S = unscented.predict_square_root(quiet, state, S, dt, spread, step=WIDTH)
        wide = square_root.lower_factor(np.hstack([S, np.sqrt(dt) * noise]))
        return state, wide * np.where(np.diag(wide) < 0.0, -1.0, 1.0)

    return Gaussian(
        x,
        np.diag(deviation),
        step,
        lambda s, p, reading: unscented.correct_square_root(s, p, reading, spread),
        factored=True,
    )


FAMILY: dict[str, Callable[[Car, Array, Array], Filter]] = {
    "CD-EKF": _extended(0),
    "CD-EKF, thrust of order 1": _extended(1),
    "CD-EKF, thrust of order 2": _extended(2),
    "DD-EKF": _discrete,
    "CC-EKF": Continuous,
    "square-root CD-EKF": _square_root,
    "UKF": _unscented,
    "square-root unscented Kalman-Bucy": _kalman_bucy,
    "adaptive high-gain EKF": HighGain,
    "particles": Bootstrap,
    "linear Kalman filter": _riding_on_a_line,
    "Luenberger": Luenberger,
}
"""Name -> (car, start (17,), its deviations (17,)) -> filter."""


def run_family(
    name: str, told: Sequence[Instant], car: Car, heading: float | None = None, fuel: float = 5e3
) -> tuple[Array, Array, Array]:
    """Let the filter `name` of `FAMILY` observe `told`. Returns times (n,), states (n, 17) and variances (n, 17).

    `heading` (rad) is believed at the start (deviation 0.1) if given; else the first course is taken over. After a
    failure of its own (a covariance that is not positive, a state that is not finite) the rest is NaN: it is lost.
    """
    x, deviation = np.zeros(17), SPREAD.copy()
    x[model.PIN], x[model.OMEGA] = fuel, car.engine.idle_speed
    if heading is not None:
        x[model.PSI], deviation[model.PSI] = heading, 0.1
    turned = heading is not None
    observer = FAMILY[name](car, x, deviation)
    states, variances = np.full((len(told), 17), np.nan), np.full((len(told), 17), np.nan)
    shut: dict[int, float] = {}
    before = told[0].time - WIDTH if len(told) else 0.0
    for k, instant in enumerate(told):
        try:
            with np.errstate(all="ignore"):
                observer.predict(instant.time - before)
                before = instant.time
                if not turned and model.GPS_COURSE in instant.kinds:
                    turned = True
                    course = float(instant.value[instant.kinds.index(model.GPS_COURSE)])
                    _turn(observer, course)
                admitted = _gated(observer, instant, car, turned, shut)
                if len(admitted.kinds):
                    kinds, value, variance, aux = admitted.kinds, admitted.value, admitted.variance, admitted.aux
                    observer.correct(car_reading(car, kinds, value, variance, aux), admitted)
                state, P = observer.moments()
        except (np.linalg.LinAlgError, ValueError, ArithmeticError):
            break
        if not np.isfinite(state).all():
            break
        states[k], variances[k] = state, np.diag(P)
    return np.array([instant.time for instant in told]), states, variances


def _turn(observer: Filter, course: float) -> None:
    """Take over a heading that nobody knew."""
    if isinstance(observer, Gaussian):
        observer.state = observer.state.copy()
        observer.state[model.PSI] = course
        second = observer.second.copy()
        second[model.PSI, :] = 0.0
        second[:, model.PSI] = 0.0
        second[model.PSI, model.PSI] = 0.1 if observer.factored else 0.01
        observer.second = second
    elif isinstance(observer, HighGain):
        observer.turn(course)
    elif isinstance(observer, Continuous | Luenberger):
        observer.x = observer.x.copy()
        observer.x[model.PSI] = course


def _gated(observer: Filter, instant: Instant, car: Car, turned: bool, shut: dict[int, float]) -> Instant:
    """`instant` without the values that lie beyond the gate, which opens again after `REOPEN` s."""
    x, P = observer.moments()
    free = HighGain.UNGATED if isinstance(observer, HighGain) else ()
    keep = []
    for i, (kind, value, variance, aux) in enumerate(
        zip(instant.kinds, instant.value, instant.variance, instant.aux, strict=True)
    ):
        placed = kind in (model.GPS_NORTH, model.GPS_EAST, model.GPS_COURSE, model.MAP_HEADING)
        if not np.isfinite(value) or (placed and not turned):
            continue
        h = model.measurement_jacobian(kind, x, car, float(aux))
        nu = value - model.measurement(kind, x, car, float(aux))
        if kind in model.HEADINGS:
            nu = (nu + np.pi) % (2.0 * np.pi) - np.pi
        if kind not in free and nu * nu > GATE * (h @ P @ h + variance):
            if instant.time - shut.setdefault(kind, instant.time) < REOPEN:
                continue
        else:
            shut.pop(kind, None)
        keep.append(i)
    kinds = tuple(instant.kinds[i] for i in keep)
    return Instant(instant.time, kinds, instant.value[keep], instant.variance[keep], instant.aux[keep])
