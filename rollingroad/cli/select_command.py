"""Which sensors are worth having: the price list."""

from typing import Annotated

import typer

from rollingroad.cli.app import CarOption, Json, Seed, app


@app.command(epilog="Examples: rollingroad select · rollingroad select --car peugeot --max-sensors 3 --json")
def select(
    car: CarOption = None,
    largest: Annotated[int, typer.Option("--max-sensors", min=1, metavar="N", help="Largest set to look for.")] = 5,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Which sensors are worth having: the best set of each size, its cost, and what it knows of thrust and slope."""
    from rich.table import Table

    from rollingroad.cli.output import console, print_json, progress
    from rollingroad.price_list import price_list
    from vehicle_model.car.files import read_car

    with progress(json) as tell:
        found = price_list(read_car(car or "smart"), largest, seed, tell)
    if json:
        print_json({"seed": seed, **found})
        return
    table = Table(title="sensors beside the injector's pulses, the best set of each size")
    table.add_column("sensors")
    for name in ("cost, EUR", "H2 norm", "thrust error, N"):
        table.add_column(name, justify="right")
    for row in found["sets"]:
        error = row["thrust_rmse_N"]
        names = ", ".join(row["sensors"]).replace("_", " ") or "none"
        table.add_row(names, f"{row['cost']:.1f}", f"{row['h2']:.3f}", "–" if error is None else f"{error:.0f}")
    console().print(table)
    word = "finds the same sets" if found["agrees_with_brute_force"] else "finds better sets of some size"
    console().print(f"brute force over all sets {word}")
