"""What every method returns: a trajectory with its costate and a certificate that says how far it may be trusted."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Certificate:
    """Pontryagin's conditions, checked on the answer itself and not taken from the solver. Refused where they fail."""

    hamiltonian_drift: float | None = None
    """Largest |H - H0| along the trajectory (H0 = 0 where time is free), as a share of the mean running cost."""
    maximum_gap: float | None = None
    """Largest H(other control) - H(own control) over a sampled control set, as a share of the mean running cost."""
    bound_distance: float | None = None
    """Smallest distance of the controls to their bounds as a share of their range: 0 where a bound is active."""
    mesh_error: float | None = None
    """Relative change of J when the mesh is halved."""
    hull_gain: float | None = None
    """Share of fuel that an oscillation about the answer's cruise would save on this map (0: convex there)."""
    refused: str | None = None
    """Why the answer is not to be used; None when it stands."""


LIMITS = {"indirect": (1e-6, 1e-6, 1e-6), "direct": (0.1, 0.1, 0.02), "dp": (0.1, 0.1, 0.02)}
"""Method -> what its drift of H, its gap in the maximum and its mesh error may be. A direct method's controls are
constant over intervals, a dynamic programme's states lie on a grid: neither can be an extremal to the last digit."""


@dataclass(frozen=True)
class Shift:
    """A change of gear."""

    before: int
    after: int
    speed: float
    """m/s."""
    engine_speed: float
    """rad/s, in the gear that is left."""
    time: float
    """s."""


@dataclass(frozen=True)
class Solution:
    """An answer to a case. Arrays over time (n,); costate lambda = -dV/dx, H = lambda f - L is maximal."""

    case: str
    method: str
    cost: float
    """J, in joules of fuel (seconds for minimum time, the quadratic cost for the linear-quadratic case)."""
    duration: float
    """s."""
    distance: float
    """m; NaN where the case has none."""
    time: NDArray[np.float64]
    state: NDArray[np.float64]
    """(n, nx)."""
    control: NDArray[np.float64]
    """(n, nu)."""
    costate: NDArray[np.float64]
    """(n, nx)."""
    gear: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    shifts: tuple[Shift, ...] = ()
    wall: float = 0.0
    """s of computing, compilation apart."""
    certificate: Certificate = field(default_factory=Certificate)
    notes: dict[str, float] = field(default_factory=dict)
    """Further figures of the case."""

    def refuse(self, reason: str) -> "Solution":
        """The same, refused."""
        return replace(self, certificate=replace(self.certificate, refused=reason))

    def judged(self) -> "Solution":
        """The same, refused where its certificate fails the limits of its kind of method; see `LIMITS`."""
        kind = next((kind for kind in LIMITS if self.method.startswith(kind)), None)
        if self.certificate.refused is not None or kind is None:
            return self
        c, (drift, gap, mesh) = self.certificate, LIMITS[kind]
        if c.hamiltonian_drift is not None and not c.hamiltonian_drift <= drift:
            return self.refuse(f"Hamiltonian drifts by {c.hamiltonian_drift:.1e} of P_in, more than {drift:.0e}")
        if c.maximum_gap is not None and not c.maximum_gap <= gap:
            return self.refuse(f"another control raises H by {c.maximum_gap:.1e} of P_in, more than {gap:.0e}")
        if c.mesh_error is not None and not c.mesh_error <= mesh:
            return self.refuse(f"halving the mesh changes J by {c.mesh_error:.1%}, more than {mesh:.0%}")
        return self

    def row(self) -> dict[str, Any]:
        """The row of `rollingroad solve --json`: a refused solution keeps its row, with J and time null."""
        stands = self.certificate.refused is None
        return {
            "method": self.method,
            "J": _number(self.cost) if stands else None,
            "time_s": _number(self.duration) if stands else None,
            "distance_m": _number(self.distance) if stands else None,
            "shifts": [
                {
                    "from": s.before,
                    "to": s.after,
                    "speed": s.speed,
                    "engine_speed": s.engine_speed,
                    "time_s": s.time,
                }
                for s in self.shifts
            ],
            "wall_s": self.wall,
            "certificate": {
                "hamiltonian_drift": _number(self.certificate.hamiltonian_drift),
                "maximum_gap": _number(self.certificate.maximum_gap),
                "bound_distance": _number(self.certificate.bound_distance),
                "mesh_error": _number(self.certificate.mesh_error),
                "hull_gain": _number(self.certificate.hull_gain),
                "refused": self.certificate.refused,
            },
            "notes": {key: _number(value) for key, value in self.notes.items()},
        }


def _number(value: float | None) -> float | None:
    """JSON has no NaN."""
    return None if value is None or not np.isfinite(value) else float(value)


def failed(case: str, method: str, reason: str) -> Solution:
    """The row of a method that found nothing."""
    empty = np.empty(0)
    return Solution(
        case, method, np.nan, np.nan, np.nan, empty, empty, empty, empty, certificate=Certificate(refused=reason)
    )
