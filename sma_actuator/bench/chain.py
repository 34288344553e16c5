"""The measuring chain: from what is true of the wire to what the DAQ's converter reads.

Calibrations are those of the thesis (appendix A and B); the sensors of the bench obey them
exactly, so that every difference is noise, quantisation or a fault.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.jit import jit

CHANNELS = (101, 102, 103, 104, 105)
RANGE_V = 10.0
LSB_V = 2 * RANGE_V / 2**16
SATURATED = 9.9e37
_CHUNK = 1024


@dataclass(frozen=True, slots=True)
class Chain:
    """Sensors, wiring and converter of the test stand."""

    reference_resistance_Ohm: float = 1.0
    lead_resistance_Ohm: float = 0.25
    load_cell_slope_N_V: float = 12.7297  # appendix A
    load_cell_offset_N: float = -0.0598
    lvdt_slope_m_A: float = 0.315842  # appendix B
    lvdt_offset_m: float = -1.2195e-3
    lvdt_shunt_Ohm: float = 10.0
    noise_V: tuple[float, ...] = (1.5e-4, 1.5e-4, 2.0e-4, 1.5e-4, 0.02)  #: rms per sample and channel (last: °C)
    quantised: bool = True

    @property
    def series_Ohm(self) -> float:
        """What the supply sees besides the wire."""
        return self.reference_resistance_Ohm + self.lead_resistance_Ohm

    def read(self, ring: np.ndarray, row: int, noise: np.ndarray) -> np.ndarray:
        """What the converter makes, (n, 5), of the true samples of ``ring`` that end before ``row``, as
        :func:`physics.simulate` writes them, and of standard normal noise, (n, 5)."""
        read = np.empty((len(noise), len(CHANNELS)))
        _read(
            ring,
            row,
            noise,
            self.reference_resistance_Ohm,
            self.load_cell_slope_N_V,
            self.load_cell_offset_N,
            self.lvdt_slope_m_A,
            self.lvdt_offset_m,
            self.lvdt_shunt_Ohm,
            self.noise_V,
            self.quantised,
            read,
        )
        return read


@jit
def _read(
    ring: np.ndarray,
    row: int,
    noise: np.ndarray,
    reference_Ohm: float,
    load_slope_N_V: float,
    load_offset_N: float,
    lvdt_slope_m_A: float,
    lvdt_offset_m: float,
    lvdt_shunt_Ohm: float,
    noise_V: tuple[float, ...],
    quantised: bool,
    read: np.ndarray,
) -> None:
    n = len(noise)
    for number in range(n):
        sample = ring[(row - n + number) % len(ring)]
        read[number, 0] = sample[1]
        read[number, 1] = sample[0] * reference_Ohm
        read[number, 2] = (sample[2] - load_offset_N) / load_slope_N_V
        read[number, 3] = (sample[3] - lvdt_offset_m) / lvdt_slope_m_A * lvdt_shunt_Ohm
        read[number, 4] = sample[4]
        for channel in range(5):
            read[number, channel] += noise[number, channel] * noise_V[channel]
        for channel in range(4):  # the last is a thermometer, and no voltage
            if quantised:
                read[number, channel] = np.round(read[number, channel] / LSB_V) * LSB_V
            if abs(read[number, channel]) >= RANGE_V:
                read[number, channel] = np.sign(read[number, channel]) * SATURATED


class Noise:
    """White noise that depends on the seed and the sample's number alone, not on who asks when."""

    def __init__(self, seed: int):
        self._seed = seed
        self._chunks: dict[int, np.ndarray] = {}

    def of(self, first: int, n: int) -> np.ndarray:
        """Standard normal numbers of samples ``first`` to ``first + n − 1``, shape (n, 5)."""
        parts = []
        chunk = first // _CHUNK
        while chunk * _CHUNK < first + n:
            if chunk not in self._chunks:
                if len(self._chunks) > 8:
                    self._chunks.pop(min(self._chunks))
                self._chunks[chunk] = np.random.default_rng((self._seed, chunk)).standard_normal(
                    (_CHUNK, len(CHANNELS))
                )
            begin = max(first - chunk * _CHUNK, 0)
            end = min(first + n - chunk * _CHUNK, _CHUNK)
            parts.append(self._chunks[chunk][begin:end])
            chunk += 1
        return parts[0] if len(parts) == 1 else np.concatenate(parts)
