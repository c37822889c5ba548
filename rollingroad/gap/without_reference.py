"""Without reference trips: the freedom of the map that trips and best cause ask for, and what is then doubtful."""

from collections.abc import Sequence

from rollingroad.gap import evidence
from rollingroad.gap.calibration import FREEDOM, Calibration, calibrate, doubted, log_evidence, reduce
from rollingroad.gap.trips import Layout, Lexicon, Trip, total_gram

LIKE_ANOTHER_CAR = frozenset({
    "rolling_resistance", "brake_drag", "accessory_load", "idle_fuel", "fuel_energy", "injector_fouling",
    "injector_dead_time", "enrichment", "map_drift", "fuel_cutoff", "cornering_drag", "driveline_loss", "clutch_slip",
    "shift_loss",
})  # fmt: skip
"""Effects that are functions of the present state alone: without references another engine looks the same."""
ALWAYS = 0.5
"""Prior deviations of such an effect that another car may have for ever."""


def foreign_floor(lexicon: Lexicon) -> dict[str, float]:
    """Floors of the effects that a foreign engine and gearbox look like for ever."""
    return {
        f"{v.effect}.{c.parameter.split('~')[0]}": ALWAYS * c.sd
        for v in lexicon.variants if v.effect in LIKE_ANOTHER_CAR for c in v.columns
    }  # fmt: skip


def without_reference(
    trips: Sequence[Trip], layout: Layout, lexicon: Lexicon, hide: Sequence[str],
    thresholds: evidence.Thresholds, coarse: bool,
) -> tuple[Calibration, list[str]]:  # fmt: skip
    """How far these trips' engine is from the simulator's own: the freedom of the correction under which trips and best
    cause together are likeliest. A foreign map is thereby never taken for an effect."""
    best: tuple[float, Calibration, float] | None = None
    for freedom in FREEDOM:
        calibration = calibrate([], layout, lexicon, coarse=coarse, freedom=freedom)
        _, whitened = doubted(trips, layout, calibration, coarse=coarse)
        gram = total_gram(whitened)
        reduced = reduce(gram, layout, calibration)
        h = evidence.hypotheses(reduced, lexicon, layout, hide, thresholds, pairs=False)
        gain = max([0.0, *h.singles.values()])
        likely = log_evidence(gram, layout, calibration) + gain
        if best is None or likely > best[0]:
            best = (likely, calibration, freedom)
    assert best is not None
    if best[2] == FREEDOM[0]:
        return best[1], []
    return best[1], [
        "no reference trips, and the engine's map is not the simulator's: what these trips show of fuel is taken for "
        "the map first; reference trips of the same car would tell the two apart"
    ]
