"""Looking at a run."""

import shutil
from pathlib import Path
from typing import Annotated

import typer

from rollingroad.cli.app import app
from rollingroad.cli.chain_commands import RunFolder


@app.command()
def view(
    run: RunFolder,
    save: Annotated[Path | None, typer.Option("--save", metavar="FILE.rrd", help="Copy it instead of opening.")] = None,
) -> int:
    """Open the run in rerun's viewer."""
    from rollingroad.viz.recording import view as open_viewer
    from vehicle_model.car.errors import BadInput

    if save is None:
        return open_viewer(run)
    if not (run / "run.rrd").is_file():
        raise BadInput(run, "run.rrd", "expected a run folder that holds a recording")
    shutil.copyfile(run / "run.rrd", save)
    return 0


@app.command()
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


@app.command(epilog="Example: rollingroad gallery --run runs/mixed-0")
def gallery(
    out: Annotated[Path, typer.Option("--out", help="Folder for the pictures.")] = Path("gallery"),
    run: Annotated[
        Path | None, typer.Option("--run", metavar="RUN", help="A run folder; without it `mixed` is run first.")
    ] = None,
) -> None:
    """The thesis' figures from our own runs."""
    from rollingroad.chain import run_chain
    from rollingroad.cli.output import console, progress
    from rollingroad.run_files import read_run
    from rollingroad.task import make_task
    from rollingroad.viz.gallery.write import write_gallery

    if run is None:
        run = Path("runs") / "mixed-0"
        with progress() as tell:
            run_chain(make_task("mixed"), run, tell=tell)
    for path in write_gallery(read_run(run), out):
        console().print(str(path), soft_wrap=True)
