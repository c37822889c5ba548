"""Makes docs/mixed.png, the picture of a run: `python docs/picture.py runs/mixed-0`."""

import sys
from pathlib import Path

from rollingroad.run_files import read_run
from rollingroad.viz.figures import draw, save
from rollingroad.viz.views import speed_chart

if __name__ == "__main__":
    save(draw(speed_chart(read_run(Path(sys.argv[1]))), width=8.0), Path(__file__).with_name("mixed.png"))
