"""Results by content: what was asked, with which code, names the file. Never recomputed, never half-written."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

PACKAGES = ("vehicle_model", "sensors", "observer", "controller", "scenarios", "sim", "rollingroad")


@cache
def code_fingerprint() -> str:
    """Hash of every source and data file of the packages: results of other code have other names."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        root = Path(str(resources.files(package)))
        for path in sorted(root.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(str(path.relative_to(root)).encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Unit:
    """A pure piece of work: `function` ("module:name") called with JSON arguments returns a JSON object."""

    function: str
    arguments: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Content address of the result."""
        asked = json.dumps([self.function, self.arguments], sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(f"{code_fingerprint()}\n{asked}".encode()).hexdigest()[:32]


@dataclass(frozen=True)
class Store:
    """A folder of results, one JSON file each, written aside and renamed."""

    folder: Path

    def path(self, unit: Unit) -> Path:
        """Where the result of `unit` lies or would lie."""
        return self.folder / unit.key[:2] / f"{unit.key}.json"

    def read(self, unit: Unit) -> dict[str, Any] | None:
        """The result of `unit`, or None where it has not been computed (or its file is damaged)."""
        try:
            kept = json.loads(self.path(unit).read_text())
        except (FileNotFoundError, ValueError):
            return None
        return kept["result"] if isinstance(kept, dict) and "result" in kept else None

    def write(self, unit: Unit, result: Mapping[str, Any]) -> None:
        """Keep `result`. Raises OSError where the disk will not take it; nothing half-written stays behind."""
        path = self.path(unit)
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = path.with_name(f"{path.name}.{os.getpid()}.part")
        try:
            aside.write_text(
                json.dumps({"function": unit.function, "arguments": unit.arguments, "result": result}, sort_keys=True)
            )
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)
