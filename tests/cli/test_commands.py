"""The command line: every command explains itself, and says what is wrong in a sentence, not a traceback."""

import subprocess
import sys

import pytest

from sma_actuator.cli.main import COMMANDS, main


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert "usage: sma-actuator" in capsys.readouterr().out


def test_help_lists_the_commands_and_loads_none_of_them():
    code = "import sys; from sma_actuator.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass\nprint('numba' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60).stdout
    assert all(command in out for command in COMMANDS)
    assert out.endswith("False\n")


@pytest.mark.parametrize(
    ("words", "sentence"),
    (
        (
            ["identify", "no.csv", "--config", "config/flexinol.yaml", "--model", "flexinol", "--out", "x.yaml"],
            "no.csv",
        ),
        (["replay", "no.csv", "--config", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
    ),
)
def test_what_a_user_can_mend_is_one_sentence_and_code_1(words, sentence, capsys, tmp_path, monkeypatch):
    root = __file__.rsplit("/tests/", 1)[0]
    monkeypatch.chdir(tmp_path)
    code = main([f"{root}/{word}" if word.startswith("config/") else word for word in words])
    error = capsys.readouterr().err
    assert code == 1
    assert sentence in error
    assert "Traceback" not in error
