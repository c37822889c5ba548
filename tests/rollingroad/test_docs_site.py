"""The documentation's site builds without a warning and can be read from the disk, on a phone and on a screen."""

import subprocess
import sys
from pathlib import Path

import pytest
from browser import CHROMIUM, visit

pytest.importorskip("mkdocs", reason="the site needs the extra 'docs'")
pytest.importorskip("mkdocstrings", reason="the site needs the extra 'docs'")
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_the_reference_is_made_from_docstrings(site):
    for name in ("reference/functions.html", "reference/data.html"):
        assert "doc-heading" in (site / name).read_text()


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("width", [360, 1440])
@pytest.mark.parametrize(
    "page", ["index", "gallery", "measured", "equations", "tutorials/filter", "reference/functions"]
)
def test_a_page_opened_from_the_disk_neither_overflows_nor_complains(site, tmp_path, page, width):
    ask = ["document.documentElement.scrollWidth"]
    seen = visit((site / f"{page}.html").as_uri(), tmp_path, width, 900, ask=ask)
    assert seen.errors == []
    assert seen.answers == [width]
