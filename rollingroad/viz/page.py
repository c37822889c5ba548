"""One self-contained HTML file from a template, charts and facts: readable without scripts, interactive with them."""

import base64
import gzip
import json
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from rollingroad.viz import figures, interactive
from rollingroad.viz.charts import Chart

_PAGES = resources.files("rollingroad.viz") / "pages"


def write_page(template: str, chart_list: Sequence[Chart], facts: dict[str, Any], path: Path) -> None:
    """Render `template` (a name in pages/) with `charts` and `facts` and write it to `path`, aside and renamed."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: (_PAGES / name).read_text("utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
    live = {chart.key: interactive.plotly_figure(chart) | {"beside": chart.beside} for chart in chart_list}
    stills = {chart.key: Markup(figures.svg(figures.draw(chart))) for chart in chart_list}
    html = environment.get_template(template).render(
        **facts,
        charts=chart_list,
        stills=stills,
        figures=Markup(json.dumps(live, allow_nan=False).replace("</", "<\\/")),
        plotly=Markup(_plotly()),
        css=Markup((_PAGES / "page.css").read_text("utf-8")),
        script=Markup((_PAGES / "page.js").read_text("utf-8")),
    )
    aside = path.with_name(path.name + ".part")
    aside.write_text(html, "utf-8")
    aside.replace(path)


@cache
def _plotly() -> str:
    """plotly.js, gzipped, in base64: two megabytes in place of five; the browser unpacks it."""
    source = (resources.files("plotly") / "package_data" / "plotly.min.js").read_bytes()
    return base64.b64encode(gzip.compress(source, 6, mtime=0)).decode()
