"""What probabilities are made of, kept beside a case on request: plain arrays, which run nothing when they are read."""

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rollingroad.gap.calibration import Reduced
from rollingroad.gap.trips import Layout
from vehicle_model.car.errors import BadInput

EVIDENCE = "evidence.npz"


def write_evidence(case: Path, reduced: Reduced, layout: Layout, hide: Sequence[str]) -> None:
    """Write `case`/evidence.npz (aside, then renamed)."""
    aside = case / f"part.{EVIDENCE}"
    np.savez_compressed(
        aside, information=reduced.information, vector=reduced.vector,
        calibration=np.array(layout.calibration, np.str_), calibration_sd=layout.calibration_sd,
        tolerance=np.array(layout.tolerance, np.str_), tolerance_sd=layout.tolerance_sd,
        counts=np.array([layout.effects, layout.generics]), hide=np.array(list(hide), np.str_),
    )  # fmt: skip
    aside.replace(case / EVIDENCE)


def read_evidence(case: Path) -> tuple[Reduced, Layout, tuple[str, ...]]:
    """What `write_evidence` wrote. Raises BadInput where there is none, or something else."""
    try:
        with np.load(case / EVIDENCE, allow_pickle=False) as kept:
            reduced = Reduced(kept["information"], kept["vector"])
            names = [tuple(str(name) for name in kept[key]) for key in ("calibration", "tolerance", "hide")]
            effects, generics = (int(n) for n in kept["counts"])
            layout = Layout(names[0], kept["calibration_sd"], names[1], kept["tolerance_sd"], effects, generics)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise BadInput(case / EVIDENCE, "", "a case diagnosed by `challenge run --keep`") from error
    if reduced.information.shape != (effects + generics,) * 2 or reduced.vector.shape != (effects + generics,):
        raise BadInput(case / EVIDENCE, "information", f"{effects + generics} columns as its own layout says")
    return reduced, layout, names[2]
