"""Model augmentation for bias compensation (seed 001, Höckerdal, Frisk and Eriksson): which A_q is possible, and which
one the data ask for. The augmented model is dx/dt = f(x - A_q q, u), dq/dt = 0, y = h(x)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def observable(F: NDArray, C: NDArray) -> bool:
    """Popov-Belevitch-Hautus test (theorem 1): (C; F - lambda I) has full column rank at every eigenvalue of F."""
    n = len(F)
    return all(
        np.linalg.matrix_rank(np.vstack([C, F - eigenvalue * np.eye(n)]), tol=1e-9 * max(1.0, np.abs(F).max())) == n
        for eigenvalue in np.linalg.eigvals(F)
    )


def augmented_system(A: NDArray, C: NDArray, A_q: NDArray, step: float) -> tuple[NDArray, NDArray]:
    """F and C of equation 4: the Euler step of `step` s of the augmented model."""
    n, n_q = A_q.shape
    F = np.block([[np.eye(n) + step * A, -step * A @ A_q], [np.zeros((n_q, n)), np.eye(n_q)]])
    return F, np.hstack([C, np.zeros((len(C), n_q))])


def possible(A: NDArray, C: NDArray, A_q: NDArray) -> bool:
    """Theorem 2: is the model augmented by `A_q` (n, n_q) observable? True if C A_q has full column rank.

    Raises ValueError where the theorem does not speak: A singular, or (C, A) not observable (ERRATA: both are needed).
    """
    if np.linalg.matrix_rank(A) < len(A):
        raise ValueError("theorem 2 needs a non-singular A")
    if not observable(np.eye(len(A)) + A, C):
        raise ValueError("theorem 2 needs an observable pair (C, A)")
    return bool(np.linalg.matrix_rank(C @ A_q) == A_q.shape[1])


def stationary_parts(signals: NDArray, window: int, tolerance: NDArray, settle: int = 0) -> list[tuple[int, int]]:
    """Return the stationary stretches [start, end) of `signals` (n, m): the rule that replaces the eye (seed 001, 4.2).

    A window of `window` samples is flat if the straight line fitted to each signal changes over it by less than that
    signal's `tolerance` (m,), and its scatter about the line is no step: the two halves' means differ by less than it,
    too. Consecutive flat windows join; the first `settle` samples of each stretch are left to the observer to settle.
    """
    n = len(signals)
    if n < window:
        return []
    position = np.arange(window) - 0.5 * (window - 1)
    sums = np.vstack([np.zeros(signals.shape[1]), np.cumsum(signals, axis=0)])
    number = np.arange(n)[:, None]
    moments = np.vstack([np.zeros(signals.shape[1]), np.cumsum(number * signals, axis=0)])
    total = sums[window:] - sums[:-window]
    first = moments[window:] - moments[:-window]
    centre = (np.arange(n - window + 1) + 0.5 * (window - 1))[:, None]
    change = (first - centre * total) / np.sum(position**2) * window
    half = window // 2
    early = (sums[half:] - sums[:-half])[: n - window + 1] / half
    late = (sums[half:] - sums[:-half])[window - half :] / half
    flat = np.all((np.abs(change) < tolerance) & (np.abs(late - early) < tolerance), axis=1)
    edges = np.diff(np.concatenate([[False], flat, [False]]).astype(int))
    stretches: list[tuple[int, int]] = []
    for first_flat, after in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        # windows on both sides of a step lean over it by a sample: the later stretch begins where the earlier ends
        begin = max(int(first_flat), stretches[-1][1]) if stretches else int(first_flat)
        stretches.append((begin, int(after) - 1 + window))
    return [(start + settle, end) for start, end in stretches if end - start - settle >= window // 2]


@dataclass(frozen=True)
class Augmentation:
    """What the data say: a basis of the space in which the bias moves, and how strongly."""

    basis: NDArray[np.float64]
    """A_q, (n, order), columns orthonormal in scaled states where `scale` was given."""
    singular_values: NDArray[np.float64]
    """Of the collected A_q q, descending, in the scaled states' unit."""
    order: int


def significant(singular_values: NDArray, noise: float, share: float = 0.05) -> int:
    """Order from the singular values (4.4): how many stand above the `noise` level and above `share` of the largest."""
    return int(np.sum(singular_values > max(noise, share * singular_values[0]))) if len(singular_values) else 0


def decompose(biases: NDArray, *, noise: float = 0.0, scale: NDArray | None = None, order: int | None = None,
              share: float = 0.05) -> Augmentation:  # fmt: skip
    """Singular value decomposition of collected A_q q, (n, k), into an Augmentation.

    `scale` (n,) makes states of unlike units comparable (the basis comes back in the states' own units). `order`
    overrides the rule of `significant`, whose `noise` is in the scaled unit.
    """
    size = np.ones(len(biases)) if scale is None else np.asarray(scale, dtype=float)
    directions, values, _ = np.linalg.svd(biases / size[:, None], full_matrices=False)
    number = significant(values, noise, share) if order is None else order
    return Augmentation(directions[:, :number] * size[:, None], values, number)


def from_measurements(next_states: NDArray, predicted: NDArray, transition: NDArray) -> NDArray[np.float64]:
    """Approach 1 (4.1): A_q q_t = (I - F_t)^-1 (x_{t+1} - f(x_t, u_t)) with x = C^+ y, shape (n, k).

    `next_states` (k, n) are the measured x_{t+1}, `predicted` (k, n) the model's step from the measured x_t,
    `transition` F_t (k, n, n). Needs a C of full column rank (every state measured) and little noise.
    """
    eye = np.eye(next_states.shape[1])
    biases = np.linalg.solve(eye - transition, (next_states - predicted)[..., None])[..., 0].T
    return np.asarray(biases, float)


def residual_gain(C: NDArray, F: NDArray, K: NDArray) -> NDArray[np.float64]:
    """How a constant A_q q shows in the stationary residual (4.2): r = G A_q q, G (n_y, n).

    G = C (I - F + K C F)^-1 (I - K C) (I - F). G v = 0 for every v in Ker C: what is not measured is not seen.
    """
    eye = np.eye(len(F))
    gain = C @ np.linalg.solve(eye - F + K @ C @ F, (eye - K @ C) @ (eye - F))
    return np.asarray(gain, float)


def from_residuals(residuals: NDArray, gains: NDArray) -> NDArray[np.float64]:
    """Approach 2 (4.2): A_q q of each stationary stretch from the default observer's mean residual, shape (n, k).

    `residuals` (k, n_y), `gains` G (k, n_y, n) of `residual_gain`, one per stretch, since F and K differ between
    operating points: equation 9 takes one G for all, which mixes them. Rows that C does not see come out zero.
    """
    return np.stack([np.linalg.pinv(G, rcond=1e-6) @ r for G, r in zip(gains, residuals, strict=True)], axis=1)


def largest_augmentation(C: NDArray) -> NDArray[np.float64]:
    """Approach 3 (4.3): as many extra states as theorem 2 allows, one unit column per measured state, (n, rank C)."""
    n = C.shape[1]
    columns: list[NDArray] = []
    for i in np.flatnonzero(np.any(C != 0.0, axis=0)):
        candidate = [*columns, np.eye(n)[:, i]]
        if np.linalg.matrix_rank(C @ np.stack(candidate, axis=1)) == len(candidate):
            columns = candidate
    return np.stack(columns, axis=1)


def subspace_angle(a: NDArray, b: NDArray) -> float:
    """Largest principal angle between the column spaces of `a` and `b`, rad (0: the same space)."""
    first, second = np.linalg.qr(a)[0], np.linalg.qr(b)[0]
    cosines = np.linalg.svd(first.T @ second, compute_uv=False)
    return float(np.arccos(np.clip(cosines.min(), -1.0, 1.0)))
