"""A wire's supply and DAQ in one: an RP2040 that starts with its output off and hears SCPI on its USB port.

Runs at power-up.  Bridge SERVICE to ground to have MicroPython's prompt instead.
"""

import machine
import usb
from board import Board
from parts import Ads1115, Gate, Hx711, Ina226, Tmp36
from scpi import Scpi

GATE, POWERED, SERVICE = 15, 14, 22
SDA, SCL = 4, 5
CELL_DATA, CELL_CLOCK = 16, 17
THERMOMETER = 26
SENSE_Ohm = 0.1  # the resistor on the board
WATCHDOG_ms = 500  # the program stands still for so long: the processor starts anew, its pins open, the gate off
WAIT_ms = 5  # for a line; less than this between two looks at the board
LONGEST_LINE = 512


def made():
    """The board and what answers for it; the gate is off before anything else is done."""
    gate = Gate(machine.Pin, machine.PWM, GATE)
    bus = machine.I2C(0, sda=machine.Pin(SDA), scl=machine.Pin(SCL), freq=400000)
    powered = machine.Pin(POWERED, machine.Pin.IN)
    cell = Hx711(
        machine.Pin(CELL_DATA, machine.Pin.IN),
        machine.Pin(CELL_CLOCK, machine.Pin.OUT, value=0),
        machine.disable_irq,
        machine.enable_irq,
    )
    board = Board(gate, powered, Ina226(bus), SENSE_Ohm, cell, Ads1115(bus), Tmp36(machine.ADC(THERMOMETER)))
    powered.irq(handler=board.pulse, trigger=machine.Pin.IRQ_RISING)
    return board, Scpi(board, "".join(f"{byte:02x}" for byte in machine.unique_id()))


class Program:
    """The endless loop, one turn at a time."""

    def __init__(self):
        self.board, self._scpi = made()
        self._watchdog = machine.WDT(timeout=WATCHDOG_ms)
        self._line = bytearray()

    def turn(self):
        """Hear, look, and show the watchdog that both were done."""
        usb.wait(WAIT_ms)
        for byte in usb.read():
            if byte == 10:
                self._obey()
            elif len(self._line) <= LONGEST_LINE:
                self._line.append(byte)
        self.board.look()
        self._watchdog.feed()

    def _obey(self):
        line, self._line = bytes(self._line), bytearray()
        if len(line) > LONGEST_LINE:
            self._scpi.too_long()
            return
        answer = self._scpi.obey(line)
        if answer is not None:
            usb.write((answer + "\n").encode())


def main():
    """Turn for ever; whatever ends that switches off, and then the watchdog starts the processor anew."""
    if not machine.Pin(SERVICE, machine.Pin.IN, machine.Pin.PULL_UP).value():
        return
    program = Program()
    try:
        while True:
            program.turn()
    finally:
        program.board.off()


if __name__ == "__main__":
    main()
