"""One definition of an optimal control problem, for every solver; and the one convention for costates.

    minimise  K(x(T)) + integral of L(x, u) dt,   dx/dt = f(x, u),   x(0) = x0,   x_i(T) = target_i where given
    H(x, u, lambda) = lambda . f - L,   d lambda/dt = -dH/dx,   u maximises H                        (B.13, B.14)
    lambda = -dV/dx, lambda0 = -1 (the maximal version); unit: that of J per unit of x.
Free time: H = 0 along the trajectory; fixed time: H constant. lambda_i(T) = -dK/dx_i where x_i(T) is free (B.18, with
ERRATA's sign and gradient). Modes (gears) are an outer, discrete control.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.controller_model import ControllerModel
from controller.solution import Certificate

Vector = Sequence[Any]
"""Numbers, numpy arrays of equal shape, or CasADi expressions: the functions below use arithmetic only."""


@dataclass(frozen=True)
class Problem:
    """See the module. `dynamics(x, u, mode)` returns nx expressions, `running_cost(x, u, mode)` one."""

    name: str
    dynamics: Callable[[Vector, Vector, int], list]
    running_cost: Callable[[Vector, Vector, int], Any]
    start: tuple[float, ...]
    target: tuple[float | None, ...]
    duration: float | None
    """s; None when free."""
    control_low: tuple[float, ...]
    control_high: tuple[float, ...]
    modes: tuple[int, ...] = (0,)
    allowed: Callable[[Vector, int], list] = lambda x, mode: []
    """Path constraints of a mode as expressions that must not be negative, scaled to about 1."""
    terminal_cost: Callable[[Vector], Any] = lambda x: 0.0
    scale: tuple[float, ...] = (1.0,)
    """Typical size of each state: conditioning only."""

    def hamiltonian(self, x: Vector, u: Vector, costate: Vector, mode: int) -> Any:
        """lambda . f - L."""
        rates = self.dynamics(x, u, mode)
        return sum(c * r for c, r in zip(costate, rates, strict=True)) - self.running_cost(x, u, mode)

    def certify(
        self,
        state: NDArray[np.float64],
        control: NDArray[np.float64],
        costate: NDArray[np.float64],
        mode: NDArray[np.int64],
        *,
        samples: int = 41,
        mesh_error: float | None = None,
    ) -> Certificate:
        """Check Pontryagin's conditions along a trajectory: state (n, nx), control (n, nu), costate (n, nx), mode (n,).

        The maximum is sought by brute force over `samples` values of each control in every allowed mode, so that no
        solver certifies itself. A mode that stands exactly at its limit is a rival only where it is the one driven: as
        one to be chosen it would leave the allowed set (constrained principle, B.2.5.3).
        """
        n = len(state)
        own = np.array(
            [
                float(self.hamiltonian(list(state[k]), list(control[k]), list(costate[k]), int(mode[k])))
                for k in range(n)
            ]
        )
        running = np.array([float(self.running_cost(list(state[k]), list(control[k]), int(mode[k]))) for k in range(n)])
        scale = max(float(np.mean(np.abs(running))), 1e-12)
        base = 0.0 if self.duration is None else float(np.median(own))
        axes = [np.linspace(a, b, samples) for a, b in zip(self.control_low, self.control_high, strict=True)]
        grid = [part.ravel() for part in np.meshgrid(*axes, indexing="ij")]
        gap = 0.0
        for k in range(n):
            for m in self.modes:
                margin = -1e-9 if m == mode[k] else 1e-9
                if any(float(g) < margin for g in self.allowed(list(state[k]), m)):
                    continue
                values = self.hamiltonian(list(state[k]), grid, list(costate[k]), m)
                gap = max(gap, float(np.max(values)) - own[k])
        width = np.asarray(self.control_high) - np.asarray(self.control_low)
        distance = np.minimum(control - np.asarray(self.control_low), np.asarray(self.control_high) - control) / width
        return Certificate(
            hamiltonian_drift=float(np.max(np.abs(own - base))) / scale,
            maximum_gap=gap / scale,
            bound_distance=max(float(distance.min()), 0.0),
            mesh_error=mesh_error,
        )


def acceleration_problem(
    model: ControllerModel,
    start_speed: float,
    target_speed: float,
    duration: float | None,
    *,
    name: str = "acceleration",
) -> Problem:
    """One dimension (4.4): reach `target_speed`, m/s, with the least fuel; `duration` None leaves time free.

    Controls: T (gears; modes 1 ...) or (w, T) (CVT; mode 0).
    """
    if model.cvt:
        return Problem(
            name=name,
            dynamics=lambda x, u, mode: [model.acceleration(x[0], u[0], u[1])],
            running_cost=lambda x, u, mode: model.fuel_power(u[0], u[1]),
            start=(start_speed,),
            target=(target_speed,),
            duration=duration,
            control_low=(model.engine_speed[0], model.torque[0]),
            control_high=(model.engine_speed[1], model.torque[1]),
            scale=(10.0,),
        )
    ratio = dict(enumerate(model.ratios, start=1))
    low, high = model.engine_speed
    return Problem(
        name=name,
        dynamics=lambda x, u, mode: [model.acceleration(x[0], ratio[mode] * x[0], u[0])],
        running_cost=lambda x, u, mode: model.running_cost(x[0], ratio[mode], u[0]),
        start=(start_speed,),
        target=(target_speed,),
        duration=duration,
        control_low=(model.torque[0],),
        control_high=(model.torque[1],),
        modes=tuple(ratio),
        allowed=lambda x, mode: [ratio[mode] * x[0] / low - 1.0, 1.0 - ratio[mode] * x[0] / high],
        scale=(10.0,),
    )
