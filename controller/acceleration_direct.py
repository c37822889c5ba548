"""The acceleration in one dimension by direct transcription and IPOPT, gears enumerated (B.3.2)."""

import time as clock

import numpy as np
from numpy.typing import NDArray

from controller.acceleration import check, shifts_of
from controller.controller_model import ControllerModel
from controller.direct import DirectAnswer, best_sequence
from controller.problem import acceleration_problem
from controller.solution import Solution, failed


def direct(
    model: ControllerModel,
    start: float,
    target: float,
    duration: float | None,
    *,
    case: str = "acceleration",
    sequences: list[tuple[int, ...]] | None = None,
    transcription: str = "collocation",
    intervals: int | None = None,
) -> Solution:
    """The same by IPOPT, gears enumerated (`controller.direct`)."""
    check(model, start, target, duration)
    problem = acceleration_problem(model, start, target, duration)
    if model.cvt:
        answer = best_sequence(
            problem,
            [(0, 0, 0)],  # three stretches of one mode: the launch wants a finer mesh than the rest
            intervals=intervals or 20,
            transcription=transcription,
            guess=[np.array([start * (target / start) ** q]) for q in (0.3, 0.6, 1.0)],
            guess_durations=(0.02, 0.1, 0.88),
        )
    else:
        tried = sequences or gear_sequences(model, start, target, duration)
        answers: list[DirectAnswer] = []
        began = clock.perf_counter()
        for sequence in tried:
            answer = best_sequence(
                problem,
                [sequence],
                intervals=intervals or 8,
                transcription=transcription,
                guess=_phase_ends(model, start, target, sequence),
                guess_control=(0.8 * model.torque[1],),
                shortest=0.02,
            )
            if answer is not None:
                answers.append(answer)
        answer = min(answers, key=lambda a: a.cost) if answers else None
        if answer is not None:
            answer = DirectAnswer(
                answer.cost, answer.time, answer.state, answer.control, answer.costate, answer.mode,
                clock.perf_counter() - began,
            )  # fmt: skip
    if answer is None:
        return failed(case, "direct", "IPOPT found no answer for any sequence of gears")
    shifts = shifts_of(model, answer.time, answer.state[:, 0], answer.mode)
    state, control, costate, mode = answer.middles()
    certificate = problem.certify(state, control, costate, mode, samples=81)
    solution = Solution(
        case=case,
        method="direct",
        cost=answer.cost,
        duration=float(answer.time[-1]),
        distance=float(np.trapezoid(answer.state[:, 0], answer.time)),
        time=answer.time,
        state=answer.state,
        control=answer.control,
        costate=answer.costate,
        gear=answer.mode,
        shifts=shifts,
        wall=answer.wall,
        certificate=certificate,
    )
    return solution.judged()


def gear_sequences(
    model: ControllerModel, start: float, target: float, duration: float | None
) -> list[tuple[int, ...]]:
    """Runs of consecutive gears worth trying; with fixed time each of them also after coasting in the highest gear."""
    gears = range(1, len(model.ratios) + 1)
    low, high = model.engine_speed
    first = [g for g in gears if low <= model.ratios[g - 1] * start <= 0.9 * high][:2]
    last = [g for g in gears if model.ratios[g - 1] * target <= high and model.ratios[g - 1] * target >= 0.5 * high]
    runs = [tuple(range(a, b + 1)) for a in first for b in last if b >= a]
    if duration is None:
        return runs
    coasting = [g for g in gears if model.ratios[g - 1] * start >= low][-1]
    return runs + [(coasting, *run) for run in runs]


def _phase_ends(
    model: ControllerModel, start: float, target: float, sequence: tuple[int, ...]
) -> list[NDArray[np.float64]]:
    """Guess of the speed at the end of each phase: shifts at three quarters of the highest engine speed."""
    ends, rest = [], list(sequence)
    if len(rest) > 1 and rest[0] > rest[1]:
        ends.append(np.array([0.95 * start]))
        rest = rest[1:]
    ends += [np.array([min(0.75 * model.engine_speed[1] / model.ratios[g - 1], target)]) for g in rest[:-1]]
    return [*ends, np.array([target])]
