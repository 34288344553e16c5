"""A table of steady points, as many people have one."""

import numpy as np


def write_table(path, count=25):
    """A loop of 17 mm, up in current and down again, that a straight line in the resistance follows on each branch."""
    up_A = np.linspace(0.0, 0.8, count)
    lines = ["branch,current_A,voltage_V,contraction_mm"]
    for branch, current_A, half_A in (("heating", up_A, 0.54), ("cooling", up_A[::-1], 0.36)):
        share = 1.0 / (1.0 + np.exp(-(current_A**2 - half_A**2) / 0.02))
        resistance_Ohm = 3.5 - (0.7 if branch == "heating" else 0.6) * share - 0.1 * (branch == "cooling")
        lines += [
            f"{branch},{i:.4f},{i * r:.5f},{17.0 * s:.3f}"
            for i, r, s in zip(current_A, resistance_Ohm, share, strict=True)
        ]
    path.write_text("\n".join(lines) + "\n")
    return path
