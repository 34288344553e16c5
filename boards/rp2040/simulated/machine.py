"""MicroPython's ``machine``, as far as the board needs it: every call goes to the simulated parts (``world.py``)."""

try:
    from js import call_world  # MicroPython in Node
except ImportError:
    from link import call_world

_handlers = {}
_told = []  # what wants no answer goes with the next that does


def call(*words):
    """The world's answer."""
    tell(*words)
    line = ";".join(_told)
    _told.clear()
    return call_world(line)


def tell(*words):
    """Say what wants no answer."""
    _told.append(" ".join([str(word) for word in words]))


def interrupt():
    """What the world asks for while the program waits."""
    for handler in _handlers.values():
        handler(None)


class Pin:
    IN, OUT, PULL_UP, IRQ_RISING = 0, 1, 1, 4

    def __init__(self, number, mode=-1, pull=-1, value=None):
        self.number = number
        if value is not None:
            call("pin", number, value)

    def value(self, value=None):
        if value is None:
            return int(call("pin", self.number))
        tell("pin", self.number, value)
        return None

    def irq(self, handler, trigger):
        _handlers[self.number] = handler


class PWM:
    def __init__(self, pin, freq, duty_ns):
        self._number = pin.number
        self.init(freq, duty_ns)

    def init(self, freq, duty_ns):
        call("pwm", self._number, freq, duty_ns)


class I2C:
    def __init__(self, number, sda, scl, freq):
        pass

    def writeto_mem(self, address, register, data):
        _acknowledged(call("to", address, register, "".join([f"{byte:02x}" for byte in data])))

    def readfrom_mem(self, address, register, count):
        text = _acknowledged(call("from", address, register, count))
        return bytes([int(text[i : i + 2], 16) for i in range(0, len(text), 2)])

    def readfrom_mem_into(self, address, register, buffer):
        buffer[:] = self.readfrom_mem(address, register, len(buffer))


def _acknowledged(text):
    if text == "none":
        raise OSError(5)
    return text


class ADC:
    def __init__(self, number):
        self._number = number

    def read_u16(self):
        return int(call("adc", self._number))


class WDT:
    def __init__(self, timeout):
        call("watchdog", timeout)

    def feed(self):
        tell("feed")


def disable_irq():
    return 0


def enable_irq(state):
    pass


def unique_id():
    return b"\x00\x01"
