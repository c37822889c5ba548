"""The command line's root and the options that several commands share."""

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
