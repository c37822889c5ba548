"""The chain and its arrows. Imports of the application stand inside the commands: `--help` must answer at once."""

from pathlib import Path
from typing import Annotated

import typer

from rollingroad.cli.app import CarOption, Json, Seed, Settings, Workers, app

RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")]


@app.command(epilog="Examples: rollingroad run · rollingroad run town --car peugeot --set head_wind.speed=4 --json")
def run(
    scenario: Annotated[str, typer.Argument(help="A shipped scenario's name or a TOML file.")] = "mixed",
    osm: Annotated[Path | None, typer.Option("--osm", help="Any OpenStreetMap extract instead.")] = None,
    start: Annotated[str | None, typer.Option("--from", metavar="LAT,LON", help="With --osm.")] = None,
    end: Annotated[str | None, typer.Option("--to", metavar="LAT,LON", help="With --osm.")] = None,
    car: CarOption = None,
    seed: Seed = 0,
    settings: Settings = None,
    out: Annotated[Path | None, typer.Option("--out", help="Run folder; runs/SCENARIO-SEED by default.")] = None,
    workers: Workers = None,
    json: Json = False,
) -> int:
    """The whole chain once: drive, sense, observe, map, plan, drive again with advice, compare."""
    from rollingroad.chain import run_chain
    from rollingroad.cli.output import print_json, progress
    from rollingroad.cli.tables import run_table
    from rollingroad.task import make_task

    task = make_task(scenario, car=car, seed=seed, settings=settings or [], osm=osm, start=start, end=end)
    folder = out or Path("runs") / f"{task.scenario.name}-{seed}"
    with progress(quiet=json) as tell:
        results = run_chain(task, folder, workers=workers, tell=tell)
    if json:
        print_json(results)
    else:
        run_table(results)
    return 0 if results["saving_percent"] is not None else 1


@app.command(epilog="Example: rollingroad drive hills --out runs/mine --set head_wind.speed=4")
def drive(
    scenario: Annotated[str, typer.Argument(help="A shipped scenario's name or a TOML file.")],
    out: Annotated[Path, typer.Option("--out", help="Run folder to begin.")],
    car: CarOption = None,
    seed: Seed = 0,
    settings: Settings = None,
) -> None:
    """Drive a scenario once, without advice: begins a run folder with the truth."""
    from rollingroad.cli.output import progress
    from rollingroad.stages import begin
    from rollingroad.task import make_task

    task = make_task(scenario, car=car, seed=seed, settings=settings or [])
    with progress() as tell:
        tell("driving")
        begin(task, out)


@app.command(epilog="Example: rollingroad sense runs/mine")
def sense(run: RunFolder) -> None:
    """Write what the sensor box would have logged on the drive."""
    from rollingroad.stages import sense_run

    sense_run(run)


@app.command(epilog="Example: rollingroad observe runs/mine")
def observe(run: RunFolder) -> None:
    """Estimate the car's states from the log, the car file and the road map alone."""
    from rollingroad.cli.output import progress
    from rollingroad.stages import observe_run

    with progress() as tell:
        tell("observing")
        observe_run(run)


@app.command("map", epilog="Example: rollingroad map runs/mine runs/other --out runs/both")
def map_(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders of one car.")],
    out: Annotated[Path | None, typer.Option("--out", help="Where the map goes; the first run by default.")] = None,
    json: Json = False,
) -> None:
    """Map the engine from the trips of one or more runs."""
    from rollingroad.cli.output import print_json, progress
    from rollingroad.cli.tables import map_table
    from rollingroad.stages import map_runs

    with progress(quiet=json) as tell:
        tell("mapping the engine")
        found = map_runs(runs, out or runs[0])
    print_json(found) if json else map_table(found)


@app.command(epilog="Example: rollingroad plan runs/mine")
def plan(run: RunFolder) -> None:
    """Plan the route on the map found, at the price of time that holds the drive's time."""
    from rollingroad.cli.output import progress
    from rollingroad.stages import plan_run

    with progress() as tell:
        tell("planning")
        plan_run(run)


@app.command(epilog="Example: rollingroad compare runs/mine --json")
def compare(run: RunFolder, workers: Workers = None, json: Json = False) -> int:
    """Drive again with advice and compare fairly; completes the run folder."""
    from rollingroad.cli.output import print_json, progress
    from rollingroad.cli.tables import run_table
    from rollingroad.stages import compare_run

    with progress(quiet=json) as tell:
        results = compare_run(run, workers=workers, tell=tell)
    print_json(results) if json else run_table(results)
    return 0 if results["saving_percent"] is not None else 1
