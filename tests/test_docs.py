"""Documents that are printed from the code are those of the code."""

import importlib
import re
from pathlib import Path

import pytest
import yaml
from markdown_it import MarkdownIt  # comes with rich

import sma_actuator

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize(
    ("module", "document"),
    (("config", "parameters.md"), ("safety.faults", "faults.md"), ("diagnosis.trace.limits", "tracing_limits.md")),
)
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


@pytest.mark.parametrize("page", [*PAGES, *(ROOT / "docs" / "tutorials").glob("*.md")], ids=lambda page: page.name)
def test_prose_is_broken_at_120_characters(page):
    text = page.read_text(encoding="utf-8")
    blocks = [block.map for block in MarkdownIt().enable("table").parse(text) if block.type == "paragraph_open"]
    prose = [line for first, end in blocks for line in text.splitlines()[first:end]]
    assert [
        line for line in prose if len(line) > 120 and not re.fullmatch(r"\s*`[^`]+`\W?", line)
    ] == []  # code is whole


@pytest.mark.parametrize(
    "path",
    [
        *(ROOT / name for name in ("pyproject.toml", "package.xml", "CITATION.cff")),
        *(ROOT / "sma_actuator" / "instruments" / "dialects").glob("*.yaml"),
    ],
    ids=lambda path: path.name,
)
def test_what_no_formatter_breaks_is_broken_at_120_characters_too(path):
    assert [line for line in path.read_text(encoding="utf-8").splitlines() if len(line) > 120] == []


def test_the_readme_is_read_to_its_end():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 800


RESULTS = ROOT / "docs" / "results"
ROWS = [
    pytest.param(row, id=row.split("|")[1].strip()[:60])
    for row in (ROOT / "docs" / "results.md").read_text(encoding="utf-8").splitlines()
    if re.search(r"\(results/[\w-]+\.txt\) \|$", row)
]


@pytest.mark.parametrize("row", ROWS)
def test_a_figure_of_the_results_is_one_that_its_command_printed(row):
    _, *cells, link = row.strip("|").split("|")
    printed = (ROOT / "docs" / re.search(r"results/[^)]+", link)[0]).read_text(encoding="utf-8")
    figures = re.findall(r"\d+(?:\.\d+)?", re.sub(r"\(aim \d+\)|\]\([^)]*\)", "", " ".join(cells)))
    assert figures
    assert set(figures) <= set(re.findall(r"\d+(?:\.\d+)?", printed))


def test_every_file_of_results_has_its_command():
    for path in RESULTS.glob("*.txt"):
        commands = re.findall(r"^\$ python (\S+)", path.read_text(encoding="utf-8"), re.MULTILINE)
        assert commands and all((ROOT / command).exists() for command in commands), path.name


def test_the_page_of_results_is_read_to_its_end():
    words = (ROOT / "docs" / "results.md").read_text(encoding="utf-8").replace("|", " ").split()
    assert len(words) <= 800


def test_every_file_that_states_a_version_states_the_same():
    stated = [
        re.search(r"<version>(.+)</version>", (ROOT / "package.xml").read_text())[1],
        re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)[1],
        re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1],
        re.search(r"^(\d\S+)", (ROOT / "CHANGELOG.rst").read_text(), re.MULTILINE)[1],
    ]
    assert stated == [sma_actuator.__version__] * 4


def test_every_file_that_states_the_day_of_the_version_states_the_same():
    days = [
        re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)[1]
        for name, pattern in (
            ("CHANGELOG.md", r"^## \S+ \((.+)\)$"),
            ("CHANGELOG.rst", r"^\d\S+ \((.+)\)$"),
            ("CITATION.cff", r"^date-released: (.+)$"),
        )
    ]
    assert len(set(days)) == 1


CHANGES = re.findall(
    r"^- .*?(?=^- |^#|\Z)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
)


def test_an_entry_of_the_changelog_has_at_most_thirty_words():
    without_addresses = [re.sub(r"\]\([^)]*\)", "]", entry).removeprefix("- ") for entry in CHANGES]
    assert [entry for entry in without_addresses if len(entry.split()) > 30] == []


def test_a_mutant_that_is_excused_is_one_of_a_line_that_is_there():
    gone = []
    for entry in yaml.safe_load((ROOT / "benchmarks" / "mutants_equivalent.yaml").read_text(encoding="utf-8")):
        source = (ROOT / "sma_actuator" / f"{entry['target']}.py").read_text(encoding="utf-8").splitlines()
        lines = [*entry.get("bounds", ()), *(each.split(" → ")[0] for each in entry.get("mutants", ()))]
        gone += [f"{entry['target']}: {line}" for line in lines if line not in {each.strip() for each in source}]
    assert gone == []
