"""Judging: fair comparisons over seeds, sweeps, the regression suite, performance."""

import sys
from typing import Annotated

import typer

from rollingroad.cli.app import Json, app


@app.command()
def bench(
    long: Annotated[bool, typer.Option("--long", help="Also fuzzing, growth exponents and the history.")] = False,
    json: Json = False,
) -> int:
    """The performance benchmarks, each beside its reference in the same process; under 15 minutes on two cores."""
    from rollingroad.cli.judge_tables import bench_table
    from rollingroad.cli.output import print_json, progress
    from rollingroad.evaluation.bench import NAMES, benchmarks, measure

    known, names = benchmarks(), list(NAMES)
    if long:
        more = benchmarks("LONG")
        known |= more
        names += [name for name in more if name not in names]
    with progress(quiet=json) as tell:
        found, skipped = measure(names, known, tell)
    print_json(found) if json else bench_table(found)
    for part in skipped:
        print(f"rollingroad: {part.name} was skipped: {part.because}", file=sys.stderr)
    return 0
