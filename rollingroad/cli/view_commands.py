"""Looking at a run."""

import shutil
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from rollingroad.cli.app import app
from rollingroad.cli.chain_commands import RunFolder


class Axis(StrEnum):
    """What the views of a recording run over."""

    time = "time"
    distance = "distance"


@app.command(epilog="Examples: rollingroad view runs/mixed-0 · rollingroad view runs/mixed-0 --over distance")
def view(
    run: RunFolder,
    over: Annotated[
        Axis, typer.Option("--over", help="Compare both drivers at the same moment, or place.")
    ] = Axis.time,
    save: Annotated[Path | None, typer.Option("--save", metavar="FILE.rrd", help="Copy it instead of opening.")] = None,
) -> int:
    """Open the run in rerun's viewer."""
    from rollingroad.viz.recording import view as open_viewer
    from vehicle_model.car.errors import BadInput

    if save is None:
        return open_viewer(run, over.value)
    if not (run / "run.rrd").is_file():
        raise BadInput(run, "run.rrd", "expected a run folder that holds a recording")
    shutil.copyfile(run / "run.rrd", save)
    return 0


@app.command(epilog="Example: rollingroad display runs/mixed-0 --pace 4")
def display(
    run: RunFolder,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="0 takes a free one.")] = 0,
    pace: Annotated[float, typer.Option("--pace", min=0.1, help="Times real time.")] = 1.0,
) -> None:
    """The driver's display as a page on loopback, replayed from the advised drive."""
    from rollingroad.cli.output import console
    from rollingroad.viz.display import replay_server

    server = replay_server(run, pace=pace, port=port)
    console().print(f"the driver's display: http://127.0.0.1:{server.server_address[1]}/  (Ctrl-C ends it)")
    server.serve_forever()


@app.command(epilog="Example: rollingroad gallery --run runs/mixed-0 --run runs/mixed-peugeot-0 --out pictures")
def gallery(
    out: Annotated[Path, typer.Option("--out", help="Folder for the page and the pictures.")] = Path("gallery"),
    run: Annotated[
        list[Path] | None,
        typer.Option(
            "--run",
            metavar="RUN",
            help="A run folder, and a second one of another car for figures 3.20 and 3.21; without it `mixed` is run "
            "with both cars.",
        ),
    ] = None,
) -> None:
    """The papers' figures from our own runs: one page, and a picture of each."""
    from rollingroad.chain import run_chain
    from rollingroad.cli.output import console, progress
    from rollingroad.run_files import read_run
    from rollingroad.task import make_task
    from rollingroad.viz.gallery.write import write_gallery
    from vehicle_model.car.errors import BadInput

    if run is not None and len(run) > 2:
        raise BadInput("--run", str(run[2]), "expected one run folder, or two")
    with progress() as tell:
        if run is None:
            run = [Path("runs") / "mixed-0", Path("runs") / "mixed-peugeot-0"]
            for car, folder in zip(("smart", "peugeot"), run, strict=True):
                if not (folder / "run.json").is_file():
                    tell(f"driving the {car}, with and without advice")
                    run_chain(make_task("mixed", car=car), folder)
        tell("reading the run")
        first, *other = [read_run(folder) for folder in run]
        paths = write_gallery(first, out, other[0] if other else None, tell=tell)
    console().print(f"{len(paths) - 1} figures in {paths[0]}", soft_wrap=True)
