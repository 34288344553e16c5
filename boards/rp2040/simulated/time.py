"""MicroPython's ``time``, in the time of the simulated parts."""

from machine import call

_WRAP = 1 << 30


def ticks_ms():
    return int(call("ticks")) // 1000 % _WRAP


def ticks_add(ticks, more):
    return (ticks + more) % _WRAP


def ticks_diff(end, start):
    return (end - start + _WRAP // 2) % _WRAP - _WRAP // 2


def sleep_us(us):
    call("sleep", us)
