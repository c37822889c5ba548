"""The `rollingroad` command: parse, call, print. Programs rely on its exit status, `--json` and one-line errors."""

import gc
import os
import sys


def main() -> None:
    """Run the command line. Exit status: 0 done, 1 ran and fell short, 2 bad input or a missing part."""
    # Imported here, so that a spawned worker, which imports this module, does not pay for the command line.
    import typer

    # The commands register when imported.
    from rollingroad.cli import (  # noqa: F401
        car_commands,
        chain_commands,
        gap_commands,
        judge_commands,
        log_commands,
        select_command,
        view_commands,
    )
    from rollingroad.cli.app import app
    from rollingroad.workers import COLLECT
    from vehicle_model.car.errors import BadInput

    gc.set_threshold(*COLLECT)
    try:
        status = typer.main.get_command(app).main(standalone_mode=False)
    except (typer.Exit, SystemExit) as stop:
        status = getattr(stop, "exit_code", getattr(stop, "code", 0))
    except typer.Abort:
        status = _told("interrupted")
    except KeyboardInterrupt:
        status = _told("interrupted", 130)
    except BadInput as error:
        status = _told(str(error))
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        status = _told(f"{place}{error.strerror or error}")
    except Exception as error:
        # Wrong usage. Typer carries its own copy of click, whose exceptions have no public name.
        if hasattr(error, "format_message"):
            sys.exit(_told(f"{error.format_message()} (see `rollingroad --help`)"))  # type: ignore[attr-defined]
        if os.environ.get("ROLLINGROAD_TRACEBACK"):
            raise
        kind = type(error).__name__
        status = _told(f"internal error, please report it: {kind}: {error} (ROLLINGROAD_TRACEBACK=1 shows where)")
    sys.stdout.flush()
    sys.exit(status if isinstance(status, int) else 0)


def _told(line: str, status: int = 2) -> int:
    print("rollingroad: " + " ".join(line.split()), file=sys.stderr)
    return status
