"""Judging: fair comparisons over seeds, sweeps, the regression suite, performance."""

import sys
from pathlib import Path
from typing import Annotated, get_args

import typer

from rollingroad.cli.app import Json, Workers, app

Cluster = Annotated[str | None, typer.Option("--cluster", metavar="ADDRESS", help="An existing Dask scheduler.")]


@app.command(epilog="Examples: rollingroad bench --json · rollingroad bench --long --history speed.jsonl")
def bench(
    long: Annotated[bool, typer.Option("--long", help="Also fuzzing, growth exponents and the history.")] = False,
    history: Annotated[Path, typer.Option("--history", help="With --long: a line is added.")] = Path("bench.jsonl"),
    json: Json = False,
) -> int:
    """The performance benchmarks, each beside its reference in the same process; under 15 minutes on two cores."""
    from rollingroad.cli.judge_tables import bench_table
    from rollingroad.cli.output import print_json, progress
    from rollingroad.evaluation.bench import NAMES, benchmarks, measure, remember

    known, names = benchmarks(), list(NAMES)
    if long:
        more = benchmarks("LONG")
        known |= more
        names += [name for name in more if name not in names]
    with progress(quiet=json) as tell:
        found, skipped = measure(names, known, tell)
    if long:
        remember(found, history)
    print_json(found) if json else bench_table(found)
    for part in skipped:
        print(f"rollingroad: {part.name} was skipped: {part.because}", file=sys.stderr)
    return 0


@app.command(epilog="Example: rollingroad evaluate --scenarios town,hills --seeds 3 --advisors pontryagin,oracle")
def evaluate(
    advisors: Annotated[str, typer.Option("--advisors", metavar="A,B")] = "pontryagin",
    baselines: Annotated[str, typer.Option("--baselines", metavar="C,D")] = "good",
    scenarios: Annotated[
        str | None, typer.Option("--scenarios", metavar="S,T", help="All that ship by default.")
    ] = None,
    car: Annotated[str, typer.Option("--car", metavar="C,D", help="Cars, by commas.")] = "smart",
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="How many, paired.")] = 5,
    first_seed: Annotated[int, typer.Option("--first-seed", min=0, help="The others follow it.")] = 0,
    signals_tell: Annotated[
        float | None,
        typer.Option("--signals-tell", metavar="M", help="Signals tell an advisor from M metres when they turn."),
    ] = None,
    oracle: Annotated[bool, typer.Option(help="Also drive as the oracle: its share and the regret account.")] = True,
    workers: Workers = None,
    cluster: Cluster = None,
    out: Annotated[Path, typer.Option("--out", help="Where finished drives are kept.")] = Path("evaluation"),
    json: Json = False,
) -> int:
    """Advisors against baseline drivers, fairly, with intervals; resumes where it was stopped."""
    from rollingroad.cli.judge_tables import evaluate_table
    from rollingroad.cli.output import print_json, progress
    from rollingroad.evaluation.evaluate import evaluate as evaluated
    from rollingroad.evaluation.evaluate import worlds_of
    from rollingroad.evaluation.store import Store
    from rollingroad.folder import write_json
    from rollingroad.task import make_task, telling
    from rollingroad.viz.evaluation_page import write_evaluation
    from scenarios.files import names
    from scenarios.schema import DriverKind
    from vehicle_model.car.errors import BadInput

    styles = get_args(DriverKind)
    for style in _listed(baselines):
        if style not in styles:
            raise BadInput("--baselines", style, f"expected one of {', '.join(styles)}")
    chosen = _listed(scenarios) if scenarios else names()
    worlds = worlds_of(
        lambda scenario, name, seed: telling(make_task(scenario, car=name, seed=seed), signals_tell),
        chosen,
        _listed(car),
        _listed(baselines),
        range(first_seed, first_seed + seeds),
    )
    store = Store(out / "units")
    with progress(quiet=json) as tell:
        found = evaluated(worlds, _listed(advisors), store, workers=workers, cluster=cluster, oracle=oracle, tell=tell)
    write_json(out / "evaluation.json", found)
    write_evaluation(found, out / "evaluation.html")
    print_json(found) if json else evaluate_table(found, out / "evaluation.html")
    return 0 if not found["failed"] and all(row["fair_saving_percent"] is not None for row in found["rows"]) else 1


@app.command(epilog="Example: rollingroad learn town --trips 8")
def learn(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO")] = "mixed",
    trips: Annotated[int, typer.Option("--trips", min=1, help="How many, each in traffic of its own.")] = 8,
    car: Annotated[str | None, typer.Option("--car", metavar="C")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the first trip; the others follow it.")] = 0,
    json: Json = False,
) -> int:
    """The map improves trip by trip and with it the advice: what the map costs, in fuel, after each trip."""
    from dataclasses import asdict

    from rollingroad.cli.judge_tables import learning_table
    from rollingroad.cli.output import print_json, progress
    from rollingroad.evaluation.learning import learning_curve
    from rollingroad.task import make_task

    task = make_task(scenario, car=car, seed=seed)
    with progress(quiet=json) as tell:
        lessons, price = learning_curve(task, trips, tell=tell)
    if json:
        head = {"scenario": task.scenario.name, "car": task.car.name, "seed": seed, "price_W": price}
        print_json(head | {"lessons": [asdict(lesson) | {"regret": lesson.regret} for lesson in lessons]})
    else:
        learning_table(lessons)
    return 0


def _listed(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


@app.command(epilog="Examples: rollingroad regress --short · rollingroad regress --accept")
def regress(
    short: Annotated[bool, typer.Option("--short", help="The set that CI runs.")] = False,
    accept: Annotated[bool, typer.Option("--accept", help="Make what is found the new baselines.")] = False,
    workers: Workers = None,
    out: Annotated[Path, typer.Option("--out", help="Where the runs that fell short are kept.")] = Path("regress"),
    json: Json = False,
) -> int:
    """The scenario regression suite against its tracked baselines; keeps the recording of what fell short."""
    import tempfile

    from rollingroad.chain import run_chain
    from rollingroad.cli.judge_tables import regress_table
    from rollingroad.cli.output import print_json, progress
    from rollingroad.evaluation import regress as suite
    from rollingroad.evaluation.store import Store
    from rollingroad.task import make_task

    rules, chosen = suite.read_suite(), suite.suite_scenarios()
    if short:
        chosen = {name: chosen[name] for name in rules.short}
    with progress(quiet=json) as tell:
        # A store of its own, thrown away: a regression suite that remembers would find nothing.
        with tempfile.TemporaryDirectory(prefix="regress-") as scratch:
            found = suite.measure(chosen, Store(Path(scratch)), workers=workers, tell=tell)
        if accept:
            suite.accept(found)
        rows = suite.differences(found, rules)
        for name in suite.worth_recording(rows):
            # Same seed, same bits: this is the run that fell short, with everything that a run keeps.
            tell(f"recording {name}")
            run_chain(make_task(chosen[name]), out / name, workers=workers)
    result = suite.as_json(rows, len(chosen))
    print_json(result) if json else regress_table(rows, len(chosen), out)
    return 1 if result["fell_short"] else 0


@app.command(epilog="Example: rollingroad sweep winds.toml --out winds")
def sweep(
    file: Annotated[Path, typer.Argument(metavar="FILE.toml", help="Command, grid of settings, seeds.")],
    workers: Workers = None,
    cluster: Cluster = None,
    out: Annotated[Path, typer.Option("--out", help="Where results are kept; sweep.json holds them all.")] = Path(
        "sweep"
    ),
    json: Json = False,
) -> int:
    """Any command over a grid of settings and seeds; resumes where it was stopped."""
    from rollingroad.cli.judge_tables import sweep_table
    from rollingroad.cli.output import print_json, progress
    from rollingroad.evaluation.store import Store
    from rollingroad.evaluation.sweep import read_sweep, run_sweep
    from rollingroad.folder import write_json

    asked = read_sweep(file)
    with progress(quiet=json) as tell:
        found = run_sweep(asked, Store(out / "units"), workers=workers, cluster=cluster, tell=tell)
    write_json(out / "sweep.json", found)
    print_json(found) if json else sweep_table(found, out / "sweep.json")
    return 1 if found["failed"] or any(row["status"] for row in found["rows"]) else 0
