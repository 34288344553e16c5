"""The parts on the board, each as its data sheet has it.  A part that does not answer raises OSError."""

from struct import unpack
from time import sleep_us


class Gate:
    """The MOSFET's gate: off, or pulses that the processor's PWM makes by itself, whatever the program does."""

    def __init__(self, pin, pwm, number):
        self._pin, self._pwm, self._number = pin, pwm, number
        self._pulses = None
        self.off()

    def off(self):
        """At once: not at the end of a pulse, as a PWM would."""
        self._pin(self._number, self._pin.OUT, value=0)
        self._pulses = None

    def pulse(self, frequency_Hz, on_ns):
        """Pulses of this length, so many in a second."""
        if self._pulses is None:
            self._pulses = self._pwm(self._pin(self._number), freq=frequency_Hz, duty_ns=on_ns)
        else:
            self._pulses.init(freq=frequency_Hz, duty_ns=on_ns)


class Ina226:
    """TI INA226: the sense resistor's voltage and that of the whole circuit, one after the other (SBOS547)."""

    CONVERSIONS_us = 320  # two of at most 154 µs
    FULL_V = 0.0819  # of the sense resistor's input
    _MAKER = b"TI"

    def __init__(self, bus, address=0x40):
        self._bus, self._address = bus, address
        self._two = bytearray(2)

    def is_there(self):
        """Whether it is one."""
        return self._bus.readfrom_mem(self._address, 0xFE, 2) == self._MAKER

    def measure(self):
        """Start both conversions, and return when they are done."""
        self._bus.writeto_mem(self._address, 0x00, b"\x40\x03")  # 140 µs each, no mean, once
        sleep_us(self.CONVERSIONS_us)

    def read(self):
        """Voltage of the circuit and of the sense resistor [V], of the last conversions."""
        self._bus.readfrom_mem_into(self._address, 0x01, self._two)
        sense_V = unpack(">h", self._two)[0] * 2.5e-6
        self._bus.readfrom_mem_into(self._address, 0x02, self._two)
        return unpack(">H", self._two)[0] * 1.25e-3, sense_V


class Ads1115:
    """TI ADS1115: AIN0 − AIN1, where a displacement sensor may be (SBAS444)."""

    def __init__(self, bus, address=0x48):
        self._bus, self._address = bus, address
        self._two = bytearray(2)

    def start(self):
        """One conversion, ±2.048 V, 1.2 ms."""
        self._bus.writeto_mem(self._address, 0x01, b"\x85\xe3")

    def is_done(self):
        """Whether it has been made."""
        self._bus.readfrom_mem_into(self._address, 0x01, self._two)
        return self._two[0] & 0x80 != 0

    def read(self):
        """Of the last conversion [V]."""
        self._bus.readfrom_mem_into(self._address, 0x00, self._two)
        return unpack(">h", self._two)[0] * 62.5e-6


class Hx711:
    """Avia HX711: the load cell's bridge, gain 128.  1 V stands for its full scale, which goes with its own supply."""

    def __init__(self, data, clock, disable_irq, enable_irq):
        self._data, self._clock = data, clock
        self._disable_irq, self._enable_irq = disable_irq, enable_irq
        clock.value(1)  # off and on again: a processor that was started anew may have left it in the middle of a word
        sleep_us(100)
        clock.value(0)

    def is_done(self):
        """Whether there is a new conversion."""
        return self._data.value() == 0

    def read(self):
        """The conversion [V]; the 25th pulse chooses gain 128 for the next one."""
        data, clock, bits = self._data, self._clock, 0
        state = self._disable_irq()  # a clock that stays high for 60 µs switches it off
        for _ in range(24):
            clock.value(1)
            clock.value(0)
            bits = bits << 1 | data.value()
        clock.value(1)
        clock.value(0)
        self._enable_irq(state)
        return (bits - (1 << 24) if bits & 1 << 23 else bits) / (1 << 23)


class Tmp36:
    """Analog Devices TMP36 at an input of the processor's converter."""

    def __init__(self, adc):
        self._adc = adc

    def read(self):
        """Temperature [°C]."""
        return 100.0 * (self._adc.read_u16() * (3.3 / 65535) - 0.5)
