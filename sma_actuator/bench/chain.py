"""The measuring chain: from what is true of the wire to what the DAQ's converter reads.

Calibrations are those of the thesis (appendix A and B); the sensors of the bench obey them
exactly, so that every difference is noise, quantisation or a fault.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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

    def channels(self, ring: np.ndarray) -> np.ndarray:
        """Noise-free channel values, (n, 5), of true samples, (n, 5), as :func:`physics.simulate` writes them."""
        current_A, voltage_V, load_N, displacement_m, ambient_C = ring.T
        return np.column_stack(
            (
                voltage_V,
                current_A * self.reference_resistance_Ohm,
                (load_N - self.load_cell_offset_N) / self.load_cell_slope_N_V,
                (displacement_m - self.lvdt_offset_m) / self.lvdt_slope_m_A * self.lvdt_shunt_Ohm,
                ambient_C,
            )
        )


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


def convert(channels: np.ndarray, noise: np.ndarray, chain: Chain) -> np.ndarray:
    """What the 16-bit converter makes of channel values and noise, both (n, 5)."""
    read = channels + noise * np.asarray(chain.noise_V)
    if chain.quantised:
        read[:, :4] = np.round(read[:, :4] / LSB_V) * LSB_V
    over = np.abs(read[:, :4]) >= RANGE_V
    read[:, :4][over] = np.sign(read[:, :4][over]) * SATURATED
    return read
