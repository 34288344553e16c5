"""Numbers of options, as the commands declare them."""

import argparse
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.base.options import number_within
from sma_actuator.cli.main import main


@given(st.floats(allow_nan=True), st.floats(-1e3, 1e3), st.floats(0.0, 1e3))
def test_what_is_within_is_taken_to_the_last_bit_and_nothing_else(value, low, width):
    convert = number_within(low, low + width)
    if low <= value <= low + width:
        assert convert(repr(value)) == value
    else:
        with pytest.raises(argparse.ArgumentTypeError, match="is not a number from"):
            convert(repr(value))


def test_without_an_end_it_may_be_for_ever():
    assert number_within(0.0)("inf") == math.inf


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("characterise --heat-time nan", "--heat-time: 'nan' is not a number from 0 to 3600"),
        ("characterise --pulses 2.5", "--pulses: '2.5' is not a whole number from 1 up"),
        ("characterise --levels 1", "--levels: '1' is not a whole number from 2 to 20"),
        ("demo --duration -5", "--duration: '-5' is not a number from 0 up"),
        ("watch --every 0", "--every: '0' is not a number from 0.01 up"),
        ("move 50% --within soon", "--within: 'soon' is not a number from 0 up"),
        ("view --port 70000", "--port: '70000' is not a whole number from 0 to 65535"),
        ("identify --jobs 0", "--jobs: '0' is not a whole number from 1 up"),
    ],
)
def test_a_command_names_the_option_and_what_is_wanted(capsys, words, sentence):
    with pytest.raises(SystemExit) as ended:
        main(words.split())
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err
