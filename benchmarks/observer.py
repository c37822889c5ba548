"""What observing costs in time, each figure beside a reference measured in the same process.

Plain functions that return rows of `rollingroad bench`. By hand: `python -m benchmarks.observer`. Each figure is the
minimum over repeats, compilation apart.
"""

import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import casadi as ca
import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from benchmarks.timing import Row, least, row
from observer import kernel, model, runge_kutta
from observer.events import prepare, with_grid
from observer.observe import observe, start
from observer.settings import DEFAULT
from sensors.box import record
from sensors.packets import decode
from vehicle_model.car.files import read_car
from vehicle_model.car.parameters import Car
from vehicle_model.plant.cycle import run_cycle

ACCELERATIONS = (model.ACCELERATION_X, model.ACCELERATION_Y, model.ACCELERATION_Z)
NOISE = np.array([1e-9, 1e-5, 3e3, 1e-7, 1e-7, 1e-4, 1e-4, 1e-5, 6e-5, 1e-8, 1.0, 4e6, 1e-6, 50.0, 1e-9, 1e-9, 1e-9])
R = np.array([0.04, 0.04, 0.25])
STEP = 0.01


def _case() -> tuple[Car, np.ndarray, np.ndarray, np.ndarray]:
    """Car, state, covariance and one reading of the accelerometer, somewhere on a road."""
    x = np.zeros(17)
    x[[1, 2, 3, 4, 8, 9, 11, 13]] = 18.0, 1500.0, 0.6, 0.03, 0.002, 0.0005, 3e4, 250.0
    spread = np.array([1.0, 0.3, 200, 0.05, 0.01, 2, 2, 2, 0.002, 3e-4, 50, 2e3, 1, 5, 0.05, 0.05, 0.05])
    return read_car("smart"), x, np.diag(spread**2), np.array([0.5, -0.6, 9.9])


def _constants(car: Car) -> np.ndarray:
    return runge_kutta.constants(
        car.mass,
        car.accelerated_mass,
        car.gravity,
        0.5 * car.air_density * car.drag_area,
        car.mass * car.rolling_resistance,
    )


class _FilterpyObserver(ExtendedKalmanFilter):
    """The same event as filterpy's user writes it: numpy, RK4 on state and covariance, its own update."""

    def __init__(self, car: Car) -> None:
        super().__init__(dim_x=17, dim_z=3)
        self.car, self.density = car, np.diag(NOISE)

    def _rates(self, x: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a = model.dynamics_jacobian(x[:, 0], self.car)
        return np.array(model.dynamics(x[:, 0], self.car))[:, None], a @ P + P @ a.T + self.density

    def predict_over(self, dt: float) -> None:
        x, P = self.x, self.P
        k1, c1 = self._rates(x, P)
        k2, c2 = self._rates(x + 0.5 * dt * k1, P + 0.5 * dt * c1)
        k3, c3 = self._rates(x + 0.5 * dt * k2, P + 0.5 * dt * c2)
        k4, c4 = self._rates(x + dt * k3, P + dt * c3)
        self.x = x + dt / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
        self.P = P + dt / 6.0 * (c1 + 2 * c2 + 2 * c3 + c4)


def _filterpy_event(events: int = 200) -> float:
    """Seconds per event of filterpy's EKF."""
    car, x, P, y = _case()

    def gradient(state: np.ndarray) -> np.ndarray:
        return np.array([model.measurement_jacobian(kind, state[:, 0], car) for kind in ACCELERATIONS])

    def predicted(state: np.ndarray) -> np.ndarray:
        return np.array([[model.measurement(kind, state[:, 0], car)] for kind in ACCELERATIONS])

    def work() -> None:
        ekf = _FilterpyObserver(car)
        ekf.x, ekf.P, ekf.R = x[:, None].copy(), P.copy(), np.diag(R)
        for _ in range(events):
            ekf.predict_over(STEP)
            ekf.update(y[:, None], gradient, predicted)

    return least(work, 3) / events


def _generated_c_event(events: int = 20_000) -> float | None:
    """Seconds per event of C that CasADi generates and the system's compiler builds; None without a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    car, x0, P0, y0 = _case()
    x, P = ca.SX.sym("x", 17), ca.SX.sym("P", 17, 17)
    rate = ca.vertcat(*model.dynamics(x, car, ca))
    a = ca.jacobian(rate, x)
    flow = ca.Function("rates", [x, P], [rate, ca.mtimes(a, P) + ca.mtimes(P, a.T) + ca.diag(NOISE)])
    k1, c1 = flow(x, P)
    k2, c2 = flow(x + 0.5 * STEP * k1, P + 0.5 * STEP * c1)
    k3, c3 = flow(x + 0.5 * STEP * k2, P + 0.5 * STEP * c2)
    k4, c4 = flow(x + STEP * k3, P + STEP * c3)
    xs, Ps = (
        x + STEP / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4),
        P + STEP / 6.0 * (c1 + 2 * c2 + 2 * c3 + c4),
    )
    state = ca.SX.sym("s", 17)
    for kind, value, r in zip(ACCELERATIONS, y0, R, strict=True):
        told = ca.SX(model.measurement(kind, state, car, 0.0, ca))
        row = ca.Function("h", [state], [told, ca.jacobian(told, state)])
        told, h = row(xs)
        ph = ca.mtimes(Ps, h.T)
        s = ca.mtimes(h, ph) + r
        xs, Ps = xs + ph * (value - told) / s, Ps - ca.mtimes(ph, ph.T) / s
    step = ca.Function("event", [x, P], [xs, Ps])
    with tempfile.TemporaryDirectory() as folder:
        source = ca.CodeGenerator("event.c")
        source.add(step)
        source.generate(folder + "/")
        library = Path(folder) / "event.so"
        command = [compiler, "-O3", "-march=native", "-fPIC", "-shared", f"{folder}/event.c", "-lm", "-o", str(library)]
        subprocess.run(command, check=True)
        built = ca.external("event", str(library))
        # CasADi's buffers: the call crosses from Python without converting anything
        buffer, run = built.buffer()
        xa, Pa, xb, Pb = x0.copy(), P0.ravel().copy(), np.zeros(17), np.zeros(17 * 17)
        buffer.set_arg(0, memoryview(xa))
        buffer.set_arg(1, memoryview(Pa))
        buffer.set_res(0, memoryview(xb))
        buffer.set_res(1, memoryview(Pb))

        def work() -> None:
            for _ in range(events):
                run()

        return least(work, 5) / events


def _event(events: int = 20_000, repeats: int = 15) -> float:
    """Seconds per event of the compiled filter."""
    car, x, P, y = _case()
    dt, readings = np.full(events, STEP), np.tile(y, (events, 1))
    constants, work = _constants(car), np.empty(runge_kutta.WORK)
    run = runge_kutta.events
    run(x.copy(), P.copy(), NOISE, dt[:1], readings[:1], R, constants, work)
    return least(lambda: run(x.copy(), P.copy(), NOISE, dt, readings, R, constants, work), repeats) / events


def observer_event() -> list[Row]:
    """One event (RK4 on x and P, three-row update), us; references: filterpy's EKF and C generated by CasADi."""
    value = _event()
    rows = [row("observer_event", value * 1e6, "us", "filterpy", _filterpy_event() * 1e6)]
    generated = _generated_c_event()
    if generated is not None:
        rows.append(row("observer_event", value * 1e6, "us", "generated C (CasADi)", generated * 1e6))
    return rows


def observer_stream(repeats: int = 3) -> list[Row]:
    """A WLTC's log decoded, observed, recorded and smoothed, x real time; reference: filterpy, filter only."""
    car = read_car("smart")
    trip, _ = run_cycle(car, "wltc")
    card = record(trip, car, seed=0)
    observe(decode(card), car)
    value = trip.duration / least(lambda: observe(decode(card), car), repeats)
    events = len(with_grid(prepare(decode(card))[0]))
    reference = trip.duration / (events * _filterpy_event())
    return [row("observer_stream", value, "x_real_time", "filterpy", reference)]


def observer_recording(repeats: int = 15) -> list[Row]:
    """The live filter over a WLTC's events with a record of every measurement, us an event; reference: without."""
    car = read_car("smart")
    trip, _ = run_cycle(car, "wltc")
    events = with_grid(prepare(decode(record(trip, car, seed=0)))[0])
    lines = int(np.count_nonzero(events[:, 1] == kernel.GRID))
    records, grid_x, grid_P = np.zeros((6 * len(events), 7)), np.zeros((lines, kernel.NX)), np.zeros((lines, kernel.NX))

    def work(recording: int) -> float:
        fresh = start(car, DEFAULT, None, float(events[0, 0]))
        f = fresh._replace(records=records, grid_x=grid_x, grid_P=grid_P)
        f.counts[kernel.RECORDING] = recording
        began = time.process_time()
        kernel.advance(events, 0, len(events), f)
        return (time.process_time() - began) / len(events) * 1e6

    work(1)
    # in turn, so that a busy machine slows both alike
    pairs = [(work(1), work(0)) for _ in range(repeats)]
    told, mute = (min(pair[k] for pair in pairs) for k in (0, 1))
    return [row("observer_recording", told, "us", "without records", mute)]


BENCHMARKS = {
    "observer_event": observer_event,
    "observer_stream": observer_stream,
}
"""Name of `rollingroad bench` -> the function that measures it."""
LONG = {"observer_recording": observer_recording}
"""The same of `rollingroad bench --long`."""


if __name__ == "__main__":
    for measured in (BENCHMARKS | LONG).values():
        for row in measured():
            print(row)
