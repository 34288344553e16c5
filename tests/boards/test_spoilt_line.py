"""What the attack does to lines, done to the board's: the current is off in time, somebody is told, and all is found
again."""

import pytest
from virtual_board import VirtualBoard

from attack.lines import _ENDS_THE_TALK, _FORGETS, _MEANS_OTHERWISE
from attack.proxy import Mischief, Proxy
from sma_actuator.driver import Driver

#: Of those that the proxy makes of a line alone, and not of its time.
_SPOILT = [
    *(each for each in _ENDS_THE_TALK if each.kind not in ("cut", "refuse", "late", "trickle", "flood")),
    *(each for each in _FORGETS if each.words not in ("CURR:PROT 1", "VOLT 19", "OUTP:PROT:WDOG OFF")),
    Mischief("slip in", "questions", words="CURR:PROT 0.9"),
    Mischief("slip in", "questions", words="VOLT 4.5"),
    Mischief("slip in", "questions", words="OUTP:PROT:WDOG:DEL 10"),
    *(Mischief(kind) for kind in {each.kind for rows in _MEANS_OTHERWISE.values() for each in rows}),
]
_QUICK = {"drop", "negated"}
_STUCK_s, _CHECK_ROUND_s, _STEPS_s = 2.0, 2.5, 0.35


@pytest.mark.parametrize(
    "mischief",
    [each if each.kind in _QUICK else pytest.param(each, marks=pytest.mark.long) for each in sorted(_SPOILT, key=str)],
    ids=str,
)
def test_a_spoilt_line_ends_without_current(mischief, monkeypatch):
    board = VirtualBoard(load_N=0.49)
    config, supply, daq = board.instruments(monkeypatch)
    proxy = Proxy(0, seed=1)
    driver = Driver(config, supply, daq, board)
    try:
        driver.open()
        drive(driver)
        assert board.world.heats
        proxy.mischief, proxy.spoilt = mischief, 0

        def spoil(line, direction):
            if not mischief.touches(direction):
                return line
            proxy.spoilt += 1
            return proxy._spoilt(line, mischief)

        board.on_its_way = spoil
        begun_s = board.now_s()
        within_s = config.safety.reading_timeout + config.supply.watchdog_timeout + _STEPS_s
        if mischief.kind in ("constant", "the one before", "slip in"):
            within_s += max(_STUCK_s, _CHECK_ROUND_s)  # until the settings have been asked for in turn
        while board.world.heats:
            output = driver.run_for(0.05)
            assert board.now_s() - begun_s <= within_s
        output = driver.run_for(0.5)
        assert output.status.fault
        board.on_its_way = lambda line, _: line
        driver.run_for(5.0)
        assert not driver.lost_instruments
        assert not board.world.heats
        drive(driver)
        assert board.world.heats
    finally:
        proxy.close()
        driver.stop()
    assert not board.world.heats


def drive(driver):
    for _ in range(2):  # a setting that does not stand is found when it is switched on, and programmed anew
        driver.run_for(0.5)
        driver.clear_fault()
        done, words = driver.enable(True)
        if done:
            break
    assert done, words
    for _ in range(8):
        driver.offer_setpoint(0.0025)
        driver.run_for(0.25)
