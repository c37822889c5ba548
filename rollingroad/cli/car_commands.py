"""The car alone: drive cycles, the dynamometer, optimal control."""

from pathlib import Path
from typing import Annotated

import typer

from rollingroad.cli.app import CarOption, Json, Settings, app


@app.command(epilog="Examples: rollingroad cycle WLTC --car peugeot · rollingroad cycle UDDS --set cold_start.soak=1")
def cycle(
    name: Annotated[str, typer.Argument(metavar="NAME_OR_FILE", help="UDDS, HWFET, US06, WLTC ... or a CSV file.")],
    car: CarOption = None,
    settings: Settings = None,
    json: Json = False,
) -> None:
    """The plant alone on a drive cycle: fuel and the energy account."""
    from rollingroad.catalogue import read_settings
    from rollingroad.cli.output import print_json
    from rollingroad.cli.tables import cycle_table
    from sim.bench_stand import cycle_account

    account = cycle_account(name, car or "smart", read_settings(settings or []))
    print_json(account) if json else cycle_table(account)


@app.command(epilog="Example: rollingroad dyno --car peugeot --json")
def dyno(car: CarOption = None, json: Json = False) -> None:
    """The virtual dynamometer: steady efficiency, 2,500 to 6,000 rpm by 100, 25 to 80 Nm."""
    from rollingroad.cli.output import print_json
    from rollingroad.cli.tables import dyno_table
    from sim.bench_stand import dynamometer

    found = dynamometer(car or "smart")
    print_json(found) if json else dyno_table(found)


@app.command(epilog="Examples: rollingroad solve six-speed-free · rollingroad solve --list")
def solve(
    case: Annotated[str | None, typer.Argument(help="A case of optimal control.")] = None,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            help="indirect, direct, dp, by commas; accelerations: indirect-multiple, direct-single, direct-multiple.",
        ),
    ] = "",
    car: CarOption = None,
    list_: Annotated[bool, typer.Option("--list", help="List the cases.")] = False,
    json: Json = False,
) -> int:
    """Solve a case of optimal control by several methods; each answer carries its certificate."""
    from inspect import getdoc

    from controller.cases import CASES, METHODS
    from controller.cases import solve as solve_case
    from rollingroad.cli.output import console, print_json
    from rollingroad.cli.tables import solve_table
    from vehicle_model.car.errors import BadInput
    from vehicle_model.car.files import read_car

    if list_ or case is None:
        if not list_:
            raise BadInput("solve", "CASE", f"expected one of {', '.join(CASES)}")
        print_json({"cases": list(CASES)}) if json else console().print(
            "\n".join(f"{name:18s} {(getdoc(solver) or '').splitlines()[0]}" for name, solver in CASES.items()),
            soft_wrap=True,
        )
        return 0
    methods = tuple(part.strip() for part in method.split(",") if part.strip()) or METHODS
    solutions = solve_case(case, methods, read_car(car) if car else None)
    rows = [solution.row() for solution in solutions]
    result = {"case": case, "solutions": rows}
    print_json(result) if json else solve_table(result)
    return 0 if any(row["certificate"]["refused"] is None for row in rows) else 1


scenarios = typer.Typer(help="What there is to drive; whether a file is valid.", no_args_is_help=True)
app.add_typer(scenarios, name="scenarios")


@scenarios.command("list", epilog="Example: rollingroad scenarios list --json")
def list_scenarios(json: Json = False) -> None:
    """The scenarios, roads' extracts and cars at hand."""
    from rollingroad.cli.output import print_json
    from rollingroad.cli.tables import scenario_table
    from rollingroad.shelf import shelf

    found = shelf()
    print_json(found) if json else scenario_table(found)


@scenarios.command(epilog="Example: rollingroad scenarios check work.toml mine.xml")
def check(files: Annotated[list[Path], typer.Argument(metavar="FILE...")], json: Json = False) -> int:
    """Tell what is wrong with scenario files (TOML) and car files (XML, TOML): one line each."""
    from rollingroad.cli.output import console, print_json
    from rollingroad.shelf import check_file

    verdicts = {str(path): check_file(path) for path in files}
    if json:
        print_json({"files": verdicts})
    else:
        for path, fault in verdicts.items():
            console().print(f"{path}: valid" if fault is None else fault, soft_wrap=True)
    return 2 if any(fault is not None for fault in verdicts.values()) else 0
