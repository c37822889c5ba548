"""Makes docs/measured.md from the tracked baselines of the regression suite: `python docs/measured.py`."""

import json
from pathlib import Path

HERE = Path(__file__).parent
BASELINES = HERE.parent / "scenarios" / "baselines"
SHIPPED = HERE.parent / "scenarios" / "files"
COLUMNS = (
    ("distance, km", "distance_km", 1.0, 1),
    ("thrust, live, %", "thrust_error", 100.0, 1),
    ("smoothed, %", "thrust_error_smoothed", 100.0, 1),
    ("efficiency, points", "efficiency_rmse", 100.0, 2),
    ("NIS", "nis_per_dof", 1.0, 2),
    ("map, points", "map_rmse", 100.0, 2),
    ("holds of the fuel, %", "map_fuel_share", 100.0, 0),
    ("fit, points", "fit_rmse", 100.0, 2),
)


def row(name: str, metrics: dict[str, float | None]) -> str:
    """One line of the table."""
    values = (metrics.get(key) for _, key, _, _ in COLUMNS)
    cells = ("–" if v is None else f"{s * v:.{d}f}" for v, (_, _, s, d) in zip(values, COLUMNS, strict=True))
    return f"| {name} | " + " | ".join(cells) + " |"


def main() -> None:
    """Write docs/measured.md."""
    read = {path.stem: json.loads(path.read_text())["metrics"] for path in sorted(BASELINES.glob("*.json"))}
    shipped = {path.stem for path in SHIPPED.glob("*.toml")}
    head = "| scenario | " + " | ".join(name for name, *_ in COLUMNS) + " |\n|" + "---|" * (len(COLUMNS) + 1)
    tables = [
        "\n".join([head, *(row(name, metrics) for name, metrics in read.items() if (name in shipped) == kind)])
        for kind in (True, False)
    ]
    text = f"""<!-- Generated: python docs/measured.py -->
# The figures measured

From the regression suite's tracked baselines (`rollingroad regress` measures them again and names what moved beyond its
tolerance): one run each, seed 0, car `smart` unless the name says otherwise, the default sensor box.

- *Thrust*: rms error while the engine drives with the clutch closed, outside shifts, in per cent of the thrust's own
  rms; live is the causal filter.
- *Efficiency*: rms error of the momentary efficiency, live, in points.
- *NIS*: mean normalised innovation squared per degree of freedom; 1 is right, less is cautious.
- *Map*: rms error over valid cells, in points, and the share of the fuel burnt that these cells hold. *Fit*: the
  closest form over the same cells (the planner gets a smoother one).

## The scenarios that ship

{tables[0]}

## Effects, faults, other drivers and cars

What the observer's error becomes when the car is not the one of the file, or a sensor fails.

{tables[1]}

## Savings

No saving stands here: that of one run is one sample. `rollingroad evaluate` gives means over paired seeds with their
intervals, and writes them as a page.
"""
    aside = HERE / "measured.md.part"
    aside.write_text(text, encoding="utf-8")
    aside.replace(HERE / "measured.md")


if __name__ == "__main__":
    main()
