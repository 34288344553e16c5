"""Documents that are printed from the code are those of the code."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize(("module", "document"), (("config", "parameters.md"), ("safety.faults", "faults.md")))
def test_printed_documents_are_up_to_date(module, document):
    text = importlib.import_module(f"sma_actuator.{module}").markdown()
    assert (ROOT / "docs" / document).read_text() == text, f"run: python -m sma_actuator.{module} > docs/{document}"


def test_the_readme_names_only_files_that_exist():
    for word in (ROOT / "README.md").read_text().replace("`", " ").replace("(", " ").replace(")", " ").split():
        if word.startswith(("docs/", "config/", "benchmarks/")) and not word.endswith("/") and "*" not in word:
            assert (ROOT / word.rstrip(".,:;")).exists(), word
