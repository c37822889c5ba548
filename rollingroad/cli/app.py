"""The commands. Each parses its options, calls one function of the application and prints what came of it.

Imports of the application stand inside the commands: `--help` must answer at once.
"""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="rollingroad",
    help="A chassis dynamometer made of software: SUMO drives a car through traffic, a cheap sensor box logs it, an "
    "observer finds the engine's map, Pontryagin turns it into advice, and the saving is measured fairly.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Every random draw comes from it.")]
CarOption = Annotated[str | None, typer.Option("--car", help="smart, peugeot, or a car file (XML or TOML).")]
Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="EFFECT.PARAMETER=VALUE", help="Depart from a neutral effect.")
]
Workers = Annotated[
    int | None, typer.Option("--workers", min=0, help="Processes: one per core by default, 0 runs in this one.")
]


@app.callback()
def _top() -> None:
    """Keeps `rollingroad COMMAND` a group of commands however few there are."""


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
