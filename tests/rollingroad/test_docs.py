"""What the documentation shows works: every block of code in it runs, every command in it is understood."""

import importlib
import os
import pkgutil
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest
import typer

import rollingroad.cli
from rollingroad.cli.app import app
from scenarios.schema import Scenario

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.M | re.S)


def blocks(language):
    return [
        pytest.param(code, id=f"{page.relative_to(ROOT)}:{number}")
        for page in PAGES
        for number, (kind, code) in enumerate(FENCE.findall(page.read_text()))
        if kind == language
    ]


def pages_with(language):
    return [
        pytest.param(page, id=str(page.relative_to(ROOT))) for page in PAGES if f"```{language}\n" in page.read_text()
    ]


@pytest.mark.parametrize("page", pages_with("python"))
def test_the_python_of_a_page_runs_from_top_to_bottom(page, tmp_path):
    code = "\n".join(code for kind, code in FENCE.findall(page.read_text()) if kind == "python")
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("code", blocks("toml"))
def test_a_scenario_shown_is_a_scenario(code):
    Scenario.model_validate(tomllib.loads(code), strict=False)


@pytest.mark.parametrize("code", blocks("bash"))
def test_every_command_shown_is_understood(code):
    """The command exists and takes these options; it is not run here."""
    for module in pkgutil.iter_modules(rollingroad.cli.__path__):
        importlib.import_module(f"rollingroad.cli.{module.name}")  # the commands register themselves
    root = typer.main.get_command(app)
    for line in code.splitlines():
        words = shlex.split(line, comments=True)
        if not words or not words[0].endswith("rollingroad"):
            continue
        command = root.commands.get(words[1])
        assert command is not None, line
        try:
            command.make_context(words[1], [word for word in words[2:] if word != "--help"])
        except click.exceptions.ClickException as error:
            pytest.fail(f"{line}: {error.format_message()}")


def commands():
    """Every command with its words, groups opened."""
    for module in pkgutil.iter_modules(rollingroad.cli.__path__):
        importlib.import_module(f"rollingroad.cli.{module.name}")
    for name, command in typer.main.get_command(app).commands.items():
        for inner, part in getattr(command, "commands", {"": command}).items():
            yield pytest.param(part, [name, inner] if inner else [name], id=f"{name} {inner}".strip())


@pytest.mark.parametrize(("command", "words"), list(commands()))
def test_every_command_s_help_ends_with_examples_that_it_understands(command, words):
    assert command.epilog, "an example is missing"
    kind, examples = command.epilog.split(": ", 1)
    assert kind in ("Example", "Examples")
    for example in examples.split(" · "):
        said = shlex.split(example)
        assert said[: 1 + len(words)] == ["rollingroad", *words]
        try:
            command.make_context(words[-1], said[1 + len(words) :])
        except click.exceptions.ClickException as error:
            pytest.fail(f"{example}: {error.format_message()}")


def test_every_page_is_in_the_site_and_every_link_leads_somewhere():
    listed = set(re.findall(r":\s+([\w/]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M))
    assert listed == {str(page.relative_to(ROOT / "docs")) for page in PAGES if "docs" in page.parts}
    for page in PAGES:
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / link).exists(), f"{page.name}: {link}"
