"""The lines that the board understands: SCPI's long and short words, in capitals or not, several on a line with ``;``.

*IDN?  *CLS  *RST  *OPC?  SYSTem:ERRor?
CURRent <A>  VOLTage <V>           what is wanted, and the voltage that is not exceeded; with ?: the setting
CURRent:PROTection <A>  VOLTage:PROTection <V>    trips; ?
OUTPut ON|OFF                      ? ; refused while a trip is latched
OUTPut:PROTection:TRIPped?         NONE, or of OCP,OVP,WDOG,GATE,METER
OUTPut:PROTection:CLEar
OUTPut:PROTection:WDOG?            1: it cannot be switched off
OUTPut:PROTection:WDOG:DELay <s>   silence after which it cuts; ?
MEASure:VOLTage?  MEASure:CURRent?
ROUTe:SCAN (@101,102:105)          whether there are such channels
FETCh? (@101,102:105)              their newest values
"""

from board import MOST_A, MOST_V, DELAYS_s

VERSION = "1"
CHANNELS = 101, 105
QUEUE = 10
_SHORT = {
    "SYSTEM": "SYST",
    "ERROR": "ERR",
    "CURRENT": "CURR",
    "VOLTAGE": "VOLT",
    "OUTPUT": "OUTP",
    "PROTECTION": "PROT",
    "TRIPPED": "TRIP",
    "CLEAR": "CLE",
    "DELAY": "DEL",
    "MEASURE": "MEAS",
    "ROUTE": "ROUT",
    "FETCH": "FETC",
}
_ERRORS = {
    -104: "Data type error",
    -109: "Missing parameter",
    -113: "Undefined header",
    -221: "Settings conflict",
    -222: "Data out of range",
    -223: "Too much data",
}


class Refused(Exception):
    """A line that cannot be obeyed; SCPI's number says why."""


class Scpi:
    """Obeys lines."""

    def __init__(self, board, serial):
        self._board, self._serial = board, serial
        self._errors = []

    def obey(self, line):
        """The answers of a line joined by ``;``, or None where there are none."""
        answers, feeds = [], None
        try:
            line = line.decode()
        except UnicodeError:
            line = "?"
        for command in line.split(";"):
            header, _, value = command.strip().partition(" ")
            if not header:
                continue
            header = _short(header)
            if header != "FETC?" and feeds is None:  # who only looks does not keep the current on
                feeds = True
            try:
                answer = self._obey(header, value.strip())
                if answer is not None:
                    answers.append(answer)
            except Refused as error:
                feeds = False  # nor does noise, or a program that takes this for something else
                self._note(error.args[0])
        if feeds:
            self._board.heard()
        return ";".join(answers) if answers else None

    def too_long(self):
        """A line did not end."""
        self._note(-223)

    def _note(self, code):
        if len(self._errors) < QUEUE:
            self._errors.append(code)

    def _obey(self, header, value):
        if header.endswith("?"):
            return self._answer(header[:-1], value)
        board = self._board
        if header == "OUTP":
            if not _truth(value):
                board.off()
            elif not board.on():
                raise Refused(-221)
        elif header == "CURR":
            board.set_current(_number(value, 0.0, MOST_A))
        elif header == "VOLT":
            board.set_voltage(_number(value, 0.0, MOST_V))
        elif header == "CURR:PROT":
            board.over_current_A = _number(value, 0.0, MOST_A)
        elif header == "VOLT:PROT":
            board.over_voltage_V = _number(value, 0.0, MOST_V)
        elif header == "OUTP:PROT:WDOG:DEL":
            board.delay_s = _number(value, *DELAYS_s)
        elif header == "OUTP:PROT:CLE":
            board.off()
            board.trips.clear()
        elif header == "ROUT:SCAN":
            _channels(value)
        elif header == "*CLS":
            self._errors.clear()
        elif header == "*RST":
            board.reset()
        else:
            raise Refused(-113)
        return None

    def _answer(self, header, value):
        board = self._board
        if header == "FETC":
            return ",".join(_text(board.measured(channel)) for channel in _channels(value))
        if header == "*IDN":
            return f"SMA Actuator,RP2040 board,{self._serial},{VERSION}"
        if header == "SYST:ERR":
            code = self._errors.pop(0) if self._errors else 0
            return f'{code},"{_ERRORS.get(code, "No error")}"'
        if header == "OUTP:PROT:TRIP":
            return ",".join(board.trips) or "NONE"
        numbers = {
            "*OPC": 1,
            "OUTP": int(board.is_on),
            "OUTP:PROT:WDOG": 1,
            "OUTP:PROT:WDOG:DEL": board.delay_s,
            "CURR": board.current_A,
            "VOLT": board.voltage_V,
            "CURR:PROT": board.over_current_A,
            "VOLT:PROT": board.over_voltage_V,
        }
        if header in numbers:
            return f"{numbers[header]:g}"
        if header == "MEAS:VOLT":
            return _text(board.measured(101))
        if header == "MEAS:CURR":
            return _text(board.shown_A)
        raise Refused(-113)


def _short(header):
    header = header.upper()
    query = header.endswith("?")
    words = [_SHORT.get(word, word) for word in header.rstrip("?").lstrip(":").split(":")]
    return ":".join(words) + ("?" if query else "")


def _number(text, least, most):
    if not text:
        raise Refused(-109)
    try:
        value = float(text)
    except ValueError:
        raise Refused(-104) from None
    if not least <= value <= most:
        raise Refused(-222)
    return value


def _truth(text):
    word = text.upper()
    if word not in ("1", "ON", "0", "OFF"):
        raise Refused(-104)
    return word in ("1", "ON")


def _channels(text):
    if not (text.startswith("(@") and text.endswith(")")):
        raise Refused(-104)
    channels = []
    for part in text[2:-1].split(","):
        first, _, last = part.partition(":")
        try:
            first, last = int(first), int(last or first)
        except ValueError:
            raise Refused(-104) from None
        if not CHANNELS[0] <= first <= last <= CHANNELS[1]:
            raise Refused(-222)
        channels += range(first, last + 1)
    return channels


def _text(value):
    return f"{value:.6E}" if value == value else "9.91E+37"  # SCPI's word for none
