"""Thresholds frozen on development data: `thresholds.json` names the seeds of the set they were chosen on."""

import json
from dataclasses import fields
from importlib import resources

from rollingroad.gap.evidence import Thresholds


def load() -> Thresholds:
    """Return the frozen thresholds."""
    text = resources.files("rollingroad.gap").joinpath("thresholds.json").read_text()
    known = {f.name for f in fields(Thresholds)}
    return Thresholds(**{key: value for key, value in json.loads(text)["values"].items() if key in known})
