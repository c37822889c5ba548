"""Real logs: bring them in, look at them."""

from pathlib import Path
from typing import Annotated

import typer

from rollingroad.cli.app import CarOption, Json, app


@app.command("import", epilog="Example: rollingroad import monday.csv tuesday.csv --layout obd_csv --out logs")
def import_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="One trip each.")],
    layout: Annotated[str, typer.Option("--layout", help="fastsim_dyno, comma2k19, obd_csv, or a TOML file.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for one NAME.parquet a trip.")],
) -> None:
    """Read real logs into the form that the observer and the diagnosis take."""
    from rollingroad.cli.output import console
    from sensors.importing import import_logs

    for path, notes in import_logs(files, layout, out):
        console().print(f"{path}", soft_wrap=True)
        for note in notes:
            console().print(f"  {note}", soft_wrap=True)


@app.command(epilog="Example: rollingroad inspect logs/ --car smart --json")
def inspect(
    logs: Annotated[list[Path], typer.Argument(metavar="LOGS", help="Log files or folders of them.")],
    car: CarOption = None,
    json: Json = False,
) -> None:
    """What a log holds and how its sensors behave: rates, gaps, damage, lags, scales, offsets, with uncertainty."""
    from rollingroad.cli.output import print_json, progress
    from rollingroad.cli.tables import inspect_table
    from rollingroad.shelf import logs_in
    from sensors.inspect import inspect as inspect_log
    from vehicle_model.car.files import read_car

    known = read_car(car) if car else None
    with progress(quiet=json) as tell:
        tell("inspecting")
        reports = {"logs": [inspect_log(log, known) for log in logs_in(logs)]}
    print_json(reports) if json else inspect_table(reports)
