"""How well a wire followed: the thesis's three errors (ch. 6), mean absolute, in % of full stroke."""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass
class TrackingErrors:
    """Sums up samples of setpoint, estimate and measured displacement [m] as they come.

    ``model`` = measured − estimated, ``control`` = desired − estimated, ``output`` = desired −
    measured.  A sample in which one of the three is not finite is left out and counted.
    """

    full_stroke_m: float
    samples: int = 0
    left_out: int = 0
    _sums: dict[str, float] = field(default_factory=lambda: {"model": 0.0, "control": 0.0, "output": 0.0})

    def add(self, setpoint_m: float, estimate_m: float, measured_m: float) -> None:
        """Count one sample."""
        if not math.isfinite(setpoint_m + estimate_m + measured_m):
            self.left_out += 1
            return
        self.samples += 1
        self._sums["model"] += abs(measured_m - estimate_m)
        self._sums["control"] += abs(setpoint_m - estimate_m)
        self._sums["output"] += abs(setpoint_m - measured_m)

    def as_dict(self) -> dict[str, float]:
        """Errors in % of full stroke, NaN without a sample, and the share of samples judged."""
        total = self.samples + self.left_out
        scale = 100.0 / (self.full_stroke_m * self.samples) if self.samples else math.nan
        out = {f"{name}_error_pct_stroke": total_m * scale for name, total_m in self._sums.items()}
        return {**out, "samples": self.samples, "judged_share": self.samples / total if total else 0.0}

    def __str__(self) -> str:
        values = self.as_dict()
        return (
            f"model error {values['model_error_pct_stroke']:.2f} %, control error "
            f"{values['control_error_pct_stroke']:.2f} %, output error {values['output_error_pct_stroke']:.2f} % of "
            f"full stroke ({self.samples} samples, {100 * values['judged_share']:.0f} % judged)"
        )
