"""The gap between simulator and reality, and the blind check of its diagnosis."""

from pathlib import Path
from typing import Annotated

import typer

from rollingroad.cli.app import Json, Seed, Workers, app


@app.command(epilog="Example: rollingroad diagnose --car smart.xml --logs trips/ --reference known/ --out diagnosis/")
def diagnose(
    car: Annotated[Path, typer.Option("--car", help="The car file that the nominal simulator is made of.")],
    logs: Annotated[Path, typer.Option("--logs", help="Folder of trips, in order of name.")],
    reference: Annotated[
        Path | None, typer.Option("--reference", help="Folder of trips that are understood: they calibrate.")
    ] = None,
    road: Annotated[Path | None, typer.Option("--road", help="OpenStreetMap, SUMO network or quad-tiles.")] = None,
    hide: Annotated[str, typer.Option("--hide", metavar="EFFECT,...", help="Out of the catalogue with these.")] = "",
    out: Annotated[Path | None, typer.Option("--out", help="Folder for diagnosis.json and report.html.")] = None,
    workers: Workers = None,
    json: Json = False,
) -> None:
    """Where the gap lies, which unmodelled effect causes it, how far it shrinks once that effect is added."""
    from rollingroad.cli.output import print_json, progress
    from rollingroad.cli.tables import diagnosis_table
    from rollingroad.folder import write_json
    from rollingroad.gap.diagnose import investigate
    from rollingroad.gap.report import write_report
    from rollingroad.gap.result import as_json
    from rollingroad.workers import cores

    hidden = tuple(effect.strip() for effect in hide.split(",") if effect.strip())
    count = cores() if workers is None else max(workers, 1)
    with progress(quiet=json) as tell:
        tell("diagnosing")
        found = investigate(car, logs, reference, road, hidden, workers=count)
    result = as_json(found)
    if out is not None:
        write_report(found, out)
        write_json(out / "diagnosis.json", result)
    print_json(result) if json else diagnosis_table(result)


challenge = typer.Typer(help="A blind set with a sealed key, the diagnosis of it, the scores.", no_args_is_help=True)
app.add_typer(challenge, name="challenge")
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="A set made by `challenge make`.")]
Cluster = Annotated[str | None, typer.Option("--cluster", metavar="ADDRESS", help="An existing Dask scheduler.")]


@challenge.command(epilog="Example: rollingroad challenge make --cases 40 --seed 7 --out blind")
def make(
    out: Annotated[Path, typer.Option("--out", help="New folder for the set.")],
    cases: Annotated[int, typer.Option("--cases", min=1)] = 200,
    seed: Seed = 0,
    workers: Workers = None,
) -> None:
    """Make a blind set: logs of drawn cars, some with an effect, and a key that only `score` opens."""
    from rollingroad.cli.output import console, progress
    from rollingroad.gap.challenge.make import make as make_set
    from rollingroad.workers import cores

    with progress() as tell:
        tell(f"making {cases} cases")
        manifest = make_set(cases, seed, out, workers=cores() if workers is None else max(workers, 1))
    console().print(f"{cases} cases in {out}; the key's hash is {manifest['key_sha256']}", soft_wrap=True)


@challenge.command("run", epilog="Example: rollingroad challenge run blind --workers 2")
def run_(
    folder: Folder,
    workers: Workers = None,
    cluster: Cluster = None,
    keep: Annotated[bool, typer.Option("--keep", help="Keep what `calibrate` reads.")] = False,
) -> int:
    """Diagnose every case of a set; what this code has done already is not done again."""
    from rollingroad.cli.output import console, progress
    from rollingroad.gap.challenge.run import run as run_set

    with progress() as tell:
        results, failed = run_set(folder, workers=workers, cluster=cluster, keep=keep, tell=tell)
    console().print(f"{len(results)} cases diagnosed in {folder}", soft_wrap=True)
    for line in failed:
        console().print(line, soft_wrap=True)
    return 1 if failed else 0


@challenge.command(epilog="Example: rollingroad challenge score blind --json")
def score(folder: Folder, json: Json = False) -> None:
    """Open the key and score the diagnoses; the page is DIR/scores.html."""
    from rollingroad.cli.output import print_json
    from rollingroad.cli.tables import score_table
    from rollingroad.gap.challenge.score import score as score_set
    from rollingroad.viz.challenge_page import write_scores

    scores = score_set(folder)
    write_scores(scores, folder / "scores.html")
    print_json(scores) if json else score_table(scores)


@challenge.command(epilog="Example: rollingroad challenge calibrate dev1 dev2 --out thresholds.json")
def calibrate(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Development sets, run with --keep.")],
    out: Annotated[Path, typer.Option("--out", help="The file of thresholds.")] = Path("thresholds.json"),
) -> None:
    """Choose the thresholds of the diagnosis on development sets; sets that are scored may not be among them."""
    from rollingroad.cli.output import console, progress
    from rollingroad.folder import write_json
    from rollingroad.gap.challenge.calibrate import calibrate as choose

    with progress() as tell:
        tell("choosing the thresholds")
        chosen = choose(folders)
    write_json(out, chosen)
    console().print(f"{chosen['cases']} cases, log score {chosen['log_score']}; thresholds in {out}", soft_wrap=True)
