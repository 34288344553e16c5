"""Documents that are printed from the code are those of the code."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize(("module", "document"), (("config", "parameters.md"), ("safety.faults", "faults.md")))
def test_printed_documents_are_up_to_date(module, document):
    text = importlib.import_module(f"sma_actuator.{module}").markdown()
    assert (ROOT / "docs" / document).read_text() == text, f"run: python -m sma_actuator.{module} > docs/{document}"


PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_names_only_files_that_exist(page):
    text = page.read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text)
    missing = [link for link in links if "://" not in link and not _exists(page.parent / link)]
    assert not missing


def _exists(path):
    return path.exists() or path.with_suffix(".md").exists()


def test_the_readme_is_read_to_its_end():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 800
