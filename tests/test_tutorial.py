"""The tutorial's commands, run as its reader would run them."""

import importlib.util
import re
from pathlib import Path

import pytest
from ports import free_port
from waiting import AS_ARGUMENTS

TUTORIAL = Path(__file__).parents[1] / "docs" / "tutorials"


@pytest.mark.long
def test_a_strangers_log_comes_to_a_driven_wire(tmp_path):
    spec = importlib.util.spec_from_file_location("tutorial_run", TUTORIAL / "run.py")
    tutorial = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tutorial)
    ports = {"5425": free_port(), "5426": free_port()}

    def ours(text):
        text = re.sub("|".join(ports), lambda found: ports[found[0]], text)
        return text.replace("--params-file node.yaml", f"--params-file node.yaml{AS_ARGUMENTS}")

    page = tutorial.run_page(tmp_path, ours)
    assert page.count("there after") == 2  # the wire came to both places
    assert (tmp_path / "wire.html").exists() and (tmp_path / "replay.html").exists()
    written = (TUTORIAL / "a_strangers_log.md").read_text()
    shown = [line for line in written.splitlines() if line.startswith("$ ")]
    assert [line for line in page.splitlines() if line.startswith("$ ")] == shown
    assert "there after" in written and "asked" in written  # the page holds what its commands printed
