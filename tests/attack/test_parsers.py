"""Of everything that reads what others wrote: nothing but a refusal with a sentence leaves; ``make fuzz`` looks
longer."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attack.parsers import PARSERS, corpus

pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
pytest.importorskip("aiohttp", reason="aiohttp is not installed (extra 'view')")
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")  # of libraries that give up a broken file as it is
NEEDS = {"xlsx": "openpyxl", "parquet": "pyarrow", "tdms": "nptdms", "h5": "h5py", "mcap": "rosbags", "db3": "rosbags"}


@pytest.fixture(params=PARSERS)
def name(request):
    pytest.importorskip(NEEDS.get(request.param, "json"))
    return request.param


def test_what_is_kept_of_it_is_read_or_refused(name):
    assert corpus(name)
    for data in corpus(name):
        PARSERS[name](data)


@st.composite
def spoilt(draw, kept):
    """An input that is kept, with pieces of it left out, doubled, replaced or cut off."""
    data = draw(st.sampled_from(kept))
    for _ in range(draw(st.integers(1, 4))):
        begin, end = sorted(draw(st.integers(0, len(data))) for _ in range(2))
        piece = draw(
            st.sampled_from([b"", data[begin:end] * 2, None, b"\0" * 8, b"\xff" * 8, b"-1e999", b"nan", b"\r"])
        )
        piece = draw(st.binary(max_size=12)) if piece is None else piece
        data = data[:begin] + piece + data[min(end, begin + 40) :]
    return data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data


def test_what_is_spoilt_is_read_or_refused(name):
    @settings(max_examples=15, derandomize=True, database=None)
    @given(spoilt(corpus(name)))
    def look(data):
        PARSERS[name](data)

    look()
