"""The gallery as a page and as pictures."""

from pathlib import Path

from rollingroad.run import Run
from rollingroad.viz import figures
from rollingroad.viz.charts import Chart
from rollingroad.viz.gallery.control import control_charts
from rollingroad.viz.gallery.efficiency import efficiency_charts
from rollingroad.viz.gallery.sensing import sensing_charts
from rollingroad.viz.page import write_page


def gallery_charts(run: Run) -> list[Chart]:
    """Every figure that one run can give, and those of optimal control, in the thesis' order."""
    made = [*sensing_charts(run), *efficiency_charts(run), *control_charts()]
    return sorted(made, key=lambda chart: _order(chart.key))


def write_gallery(run: Run, folder: Path) -> list[Path]:
    """Write index.html and one PNG per figure into `folder`, which is made; return the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    made = gallery_charts(run)
    r = run.results
    write_page("gallery.html.j2", made, {"r": r}, folder / "index.html")
    paths = [folder / "index.html"]
    for chart in made:
        paths.append(folder / f"{chart.key}.png")
        figures.save(figures.draw(chart), paths[-1])
    return paths


def _order(key: str) -> tuple[str, int, str]:
    chapter, number = key.removeprefix("figure-").split(".")
    part = number.lstrip("0123456789")
    return chapter, int(number.removesuffix(part)), part
