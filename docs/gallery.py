"""Makes docs/gallery.md and docs/gallery/*.png: `python docs/gallery.py RUN [RUN_OF_ANOTHER_CAR]`."""

import sys
from pathlib import Path

from PIL import Image

from rollingroad.run_files import read_run
from rollingroad.viz.figures import draw, save
from rollingroad.viz.gallery.write import gallery_sections

HERE = Path(__file__).parent


def main() -> None:
    """Draw every figure small, and list it with its caption."""
    runs = [read_run(Path(folder)) for folder in sys.argv[1:3]]
    named = "; ".join(f"{r.results['scenario']}, {r.results['car']}, seed {r.results['seed']}" for r in runs)
    lines = [
        "# Gallery",
        "",
        "The figures of the papers behind Rollingroad, numbered as there, made from runs of our own by `rollingroad "
        f"gallery` (its page is interactive). Runs here: {named}. Where a figure departs from the printed one, its "
        "caption says so.",
    ]
    pictures = HERE / "gallery"
    pictures.mkdir(exist_ok=True)
    for section in gallery_sections(*runs):
        lines += ["", f"## {section.title}"]
        for chart in section.charts:
            path = pictures / f"{chart.key}.png"
            save(draw(chart), path)
            with Image.open(path) as picture:
                # a palette takes a third of the bytes, and a line drawing loses nothing by it
                small = picture.convert("RGB").resize((800, 800 * picture.height // picture.width))
                small.quantize(256, kmeans=2).save(path, optimize=True)
            lines += ["", f"### {chart.title}", "", f"![{chart.title}](gallery/{chart.key}.png)", "", chart.caption]
    aside = HERE / "gallery.md.part"
    aside.write_text("\n".join(lines) + "\n", encoding="utf-8")
    aside.replace(HERE / "gallery.md")


if __name__ == "__main__":
    main()
