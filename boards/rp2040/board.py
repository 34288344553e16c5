"""What the board does for a wire: pulses that heat it as a direct current would, and what they show of it.

Current flows in pulses of the supply's whole voltage.  Measured is while it flows, so also the smallest current is
measured with the largest voltages.  Said and understood is everywhere the direct current (and voltage) that heats as
the pulses do: with a share d of the time on, √d times what flows while it is on.  The ratio of two voltages, from which
the resistance follows, is the same; and current² × resistance is the mean power.

A pulse lasts ON_us, as long as a measurement takes, and the more current is wanted the more of them come; from MOST_Hz
on they become longer.
"""

from math import sqrt
from time import ticks_add, ticks_diff, ticks_ms

ON_us = 600
LEAST_Hz, MOST_Hz = 10, 100
LEAST_SHARE, MOST_SHARE = 1e-6 * ON_us * LEAST_Hz, 0.95  # there is always a pause, in which a broken MOSFET shows
MISSED_ms = 350  # three periods of the slowest pulses without one that was measured
OLD_ms = 500  # what is older is not told as a measurement
WORD_ms = 3  # of the load cell, and what a clock of whole milliseconds and the turn before it take
REST_ms = 20  # between two looks while nothing flows
LEAK_A = 0.005  # with the gate off flows less
SAME = 0.002  # a share of the time that differs by less is left as it is
NAN = float("nan")

MOST_A, MOST_V = 1.0, 5.0
DELAYS_s = 0.1, 10.0


class Board:
    """One output, its protections and watchdog, and five channels.  Starts off."""

    def __init__(self, gate, powered, meter, sense_Ohm, cell, converter, thermometer):
        self._gate, self._powered, self._meter, self._sense_Ohm = gate, powered, meter, sense_Ohm
        self._cell, self._converter, self._thermometer = cell, converter, thermometer
        self.trips, self.is_on = [], False
        self.reset()
        self._rest_V = 0.0, 0.0  # at the circuit and the sense resistor, while nothing should flow
        self._full_V = None  # the same in the last pulse
        self._seen_ms = self._cell_ms = self._converter_ms = ticks_add(ticks_ms(), -OLD_ms)
        self._cell_V = self._converter_V = NAN
        self._converts = False
        if not meter.is_there():
            self.trip("METER")

    def reset(self):
        """Settings as at power-up; trips stay."""
        self.off()
        self.current_A = self.voltage_V = 0.0
        self.over_current_A, self.over_voltage_V = MOST_A, MOST_V
        self.delay_s = 1.0
        self.heard()

    # --- the output

    def set_current(self, current_A):
        """The current that is wanted [A]."""
        self.current_A = current_A
        self._regulate()

    def set_voltage(self, voltage_V):
        """The voltage that is not exceeded [V]."""
        self.voltage_V = voltage_V
        self._regulate()

    def on(self):
        """Let it flow; False while a trip is latched."""
        if self.trips:
            return False
        if not self.is_on:
            self.is_on, self._full_V = True, None
            self._regulate()
        return True

    def off(self):
        """Nothing flows any more, and what was measured of it does not count."""
        self._gate.off()
        if self.is_on:
            self._seen_ms = ticks_add(ticks_ms(), -REST_ms - 1)  # the next look is whether that is so
        self.is_on, self._share, self._pulse = False, 0.0, None

    def trip(self, word):
        """Off until it is cleared."""
        self.off()
        if word not in self.trips:
            self.trips.append(word)

    def _regulate(self):
        """As many pulses as make the wanted current, by what flows in one; the first one is only a look."""
        if not self.is_on:
            return
        if self._full_V is None:
            share = LEAST_SHARE if self.current_A > 0.0 else 0.0
        else:
            circuit_V, sense_V = self._full_V
            wanted_V = self.current_A * self._sense_Ohm
            share = min(_share(wanted_V, sense_V), _share(self.voltage_V, circuit_V), MOST_SHARE)
        if share < LEAST_SHARE:  # less than was asked for, never more
            self._gate.off()
            self._share = 0.0
            return
        if self._share and abs(share - self._share) <= SAME * share:
            return
        if not self._share:
            self._seen_ms = ticks_ms()
        frequency_Hz = max(LEAST_Hz, min(int(share * 1e6 / ON_us), MOST_Hz))
        on_ns = int(1e9 * share / frequency_Hz)
        self._gate.pulse(frequency_Hz, on_ns)
        self._share, self._period_ms = 1e-9 * frequency_Hz * on_ns, 1000 / frequency_Hz

    # --- what is measured

    def pulse(self, _):
        """An interrupt: a pulse has begun.  Measure, if it lasts long enough; what follows from it is for ``look``."""
        share = self._share
        if not share or not self._powered.value():
            return
        try:
            self._meter.measure()
            if self._powered.value() and self._share == share:
                self._pulse = self._meter.read(), share
        except OSError:
            pass  # it will be missed

    def _see(self, voltage_V, sense_V, share):
        root = sqrt(share)
        self._full_V, self._seen_ms = (voltage_V, sense_V), ticks_ms()
        if sense_V / self._sense_Ohm * root > self.over_current_A or sense_V >= self._meter.FULL_V:
            self.trip("OCP")
        elif voltage_V * root > self.over_voltage_V:
            self.trip("OVP")
        self._regulate()

    def _see_nothing_flow(self):
        self._meter.measure()
        self._rest_V, self._seen_ms = self._meter.read(), ticks_ms()
        if self._rest_V[1] / self._sense_Ohm > LEAK_A:
            self.trip("GATE")

    def look(self):
        """Between two lines: watchdog, pulses that do not come, and the slow parts."""
        now_ms = ticks_ms()
        if self.is_on and ticks_diff(now_ms, self._heard_ms) > 1000 * self.delay_s:
            self.trip("WDOG")
        seen, self._pulse = self._pulse, None
        if seen is not None and self._share:
            self._see(*seen[0], seen[1])
        unseen_ms = ticks_diff(now_ms, self._seen_ms)
        if self._share and unseen_ms > MISSED_ms:
            self.trip("GATE")
        elif not self._share and unseen_ms > REST_ms:
            try:
                self._see_nothing_flow()
            except OSError:
                self.trip("METER")
        if self._is_between_pulses(unseen_ms) and self._cell.is_done():
            self._cell_V, self._cell_ms = self._cell.read(), now_ms
        try:
            if self._converts and self._converter.is_done():
                self._converter_V, self._converter_ms, self._converts = self._converter.read(), now_ms, False
            if not self._converts:
                self._converter.start()
                self._converts = True
        except OSError:  # nobody has to have one
            self._converts = False

    def _is_between_pulses(self, unseen_ms):
        """Whether there is time for a word of the load cell, which takes as long as a pulse and must never hide one."""
        return not self._share or unseen_ms % self._period_ms + WORD_ms < self._period_ms

    def measured(self, channel):
        """The newest of a channel: 101 circuit, 102 sense resistor, 103 load cell, 104 displacement sensor [V], 105
        room [°C]."""
        if channel == 105:
            return self._thermometer.read()
        if channel == 104:
            value, seen_ms = self._converter_V, self._converter_ms
        elif channel == 103:
            value, seen_ms = self._cell_V, self._cell_ms
        else:
            value, seen_ms = self._shown_V()[channel - 101], self._seen_ms
        return value if ticks_diff(ticks_ms(), seen_ms) < OLD_ms else NAN

    def _shown_V(self):
        """Of the circuit and the sense resistor, as direct voltages: what a pulse had, with the share that is now."""
        if not self._share or self._full_V is None:
            return self._rest_V
        root = sqrt(self._share)
        return self._full_V[0] * root, self._full_V[1] * root

    @property
    def shown_A(self):
        """The direct current that heats as the pulses do [A]."""
        return self.measured(102) / self._sense_Ohm

    # --- the watchdog of the line

    def heard(self):
        """A line has come that could be obeyed."""
        self._heard_ms = ticks_ms()


def _share(wanted, full):
    """Of the time, that makes ``wanted`` of ``full``."""
    return (wanted / full) ** 2 if full > wanted else 1.0
