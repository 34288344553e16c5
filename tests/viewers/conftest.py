"""What the loop says, to be recorded and served."""

import pytest


@pytest.fixture
def outputs(make_rig):
    """What the loop says while the output is off and no position is known, and while the wire is driven."""
    rig = make_rig()
    off = rig.output
    rig.enable()
    rig.track()
    return [off, *rig.outputs[-5:]]
