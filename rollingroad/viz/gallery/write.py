"""The gallery as a page and as pictures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rollingroad.run import Run
from rollingroad.viz import figures
from rollingroad.viz.charts import Chart
from rollingroad.viz.gallery.control import control_charts
from rollingroad.viz.gallery.diesel import diesel_charts
from rollingroad.viz.gallery.efficiency import efficiency_charts, other_car_charts
from rollingroad.viz.gallery.priors import prior_charts
from rollingroad.viz.gallery.selection import selection_charts
from rollingroad.viz.gallery.sensing import sensing_charts
from rollingroad.viz.page import write_page


@dataclass(frozen=True)
class Section:
    """The figures made after one document."""

    key: str
    title: str
    charts: tuple[Chart, ...]


def gallery_sections(
    run: Run, other: Run | None = None, *, tell: Callable[[str], None] = lambda text: None
) -> list[Section]:
    """Every figure, by document. `other` is a run of another car, for 3.20 and 3.21, which are left out without it."""
    tell("figures of the run")
    thesis = [*sensing_charts(run), *efficiency_charts(run), *(other_car_charts(other) if other else [])]
    tell("figures of optimal control")
    thesis += control_charts()
    tell("figures of the prior estimators")
    priors = prior_charts()
    tell("figures of the diesel engine")
    augmentation, adaptation = diesel_charts()
    tell("figures of sensor selection")
    selection = selection_charts()
    return [
        Section("thesis", "Optimal observers and optimal control", tuple(sorted(thesis, key=_order))),
        Section("priors", "Prior information in estimation", tuple(priors)),
        Section("bias", "Bias augmentation", tuple(augmentation)),
        Section("adaptation", "Engine map adaptation", tuple(adaptation)),
        Section("selection", "Sensor selection", tuple(selection)),
    ]


def write_gallery(
    run: Run, folder: Path, other: Run | None = None, *, tell: Callable[[str], None] = lambda text: None
) -> list[Path]:
    """Write index.html and one PNG per figure into `folder`, which is made; return the paths."""
    sections = gallery_sections(run, other, tell=tell)
    made = [chart for section in sections for chart in section.charts]
    folder.mkdir(parents=True, exist_ok=True)
    tell("writing the page")
    paths = [folder / "index.html"]
    write_page("gallery.html.j2", made, {"sections": sections, "runs": _named(run, other)}, paths[0])
    for number, chart in enumerate(made, start=1):
        tell(f"drawing {number} of {len(made)}")
        paths.append(folder / f"{chart.key}.png")
        figures.save(figures.draw(chart, titled=True), paths[-1])
    return paths


def _named(*runs: Run | None) -> Sequence[str]:
    return [f"{r.results['scenario']}, {r.results['car']}, seed {r.results['seed']}" for r in runs if r]


def _order(chart: Chart) -> tuple[str, int, str]:
    chapter, number = chart.key.removeprefix("figure-").split(".")
    part = number.lstrip("0123456789")
    return chapter, int(number.removesuffix(part)), part
