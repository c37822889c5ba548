"""Tables of what was judged."""

from collections.abc import Mapping
from typing import Any

from rich.table import Table

from rollingroad.cli.output import console


def bench_table(found: Mapping[str, Any]) -> None:
    """Print each figure beside its reference."""
    table = Table(title="each beside its reference, measured in the same process")
    for name in ("benchmark", "value", "unit", "reference", "its value", "times faster"):
        table.add_column(name, justify="right" if name in ("value", "its value", "times faster") else "left")
    for row in found["benchmarks"]:
        table.add_row(
            row["name"].replace("_", " "),
            f"{row['value']:.4g}",
            row["unit"].replace("_", " "),
            row["reference"],
            f"{row['reference_value']:.4g}",
            f"{row['ratio']:.3g}",
        )
    console().print(table)
