"""The simulated current-controlled supply: settings, protections, watchdog."""

from __future__ import annotations

from math import inf

STRONGEST_A = 1.0  #: what it gives at the most, unless a stand wants a stronger one
CURRENT_STEP_A = 20e-6
VOLTAGE_RANGE_V = (0.0, 20.0)
LEAST_OCP_A, OCP_TIMES = 0.01, 1.2  #: the largest over-current trip is so many times what it gives
OVP_RANGE_V = (0.1, 22.0)
WATCHDOG_RANGE_s = (0.05, 3600.0)


class SettingRefused(ValueError):
    """A setting outside its range (SCPI −222) or in conflict with the state (−221)."""

    def __init__(self, code: int, message: str):
        self.code = code
        super().__init__(message)


class SimulatedSupply:
    """State of the supply.  Its bench applies it to the wire and calls back when a protection trips."""

    def __init__(self, strongest_A: float = STRONGEST_A) -> None:
        self.current_range_A = (0.0, strongest_A)
        self.ocp_range_A = (LEAST_OCP_A, OCP_TIMES * strongest_A)
        self.trips: list[str] = []
        self.reset()

    def reset(self) -> None:
        """Settings as at power-on.  Latched trips stay latched."""
        self.current_A = 0.0
        self.voltage_V = 0.0
        self.output_on = False
        self.ocp_A = self.ocp_range_A[1]
        self.ocp_on = True
        self.ovp_V = OVP_RANGE_V[1]
        self.ovp_on = True
        self.watchdog_on = False
        self.watchdog_tied = False  #: fed by the connection that armed it alone
        self.watchdog_delay_s = 60.0
        self.last_command_s = 0.0

    def set_current(self, current_A: float) -> None:
        """Current setting [A], rounded to its 20 µA steps; raises SettingRefused outside its range."""
        self.current_A = round(_ranged(current_A, self.current_range_A, "A") / CURRENT_STEP_A) * CURRENT_STEP_A

    def set_voltage(self, voltage_V: float) -> None:
        """Compliance voltage [V]; raises SettingRefused outside 0–20 V."""
        self.voltage_V = _ranged(voltage_V, VOLTAGE_RANGE_V, "V")

    def set_ocp(self, current_A: float) -> None:
        """Over-current trip [A]."""
        self.ocp_A = _ranged(current_A, self.ocp_range_A, "A")

    def set_ovp(self, voltage_V: float) -> None:
        """Over-voltage trip [V]."""
        self.ovp_V = _ranged(voltage_V, OVP_RANGE_V, "V")

    def set_watchdog_delay(self, delay_s: float) -> None:
        """Silence [s] after which an armed watchdog cuts the output."""
        self.watchdog_delay_s = _ranged(delay_s, WATCHDOG_RANGE_s, "s")

    def set_output(self, on: bool) -> None:
        """Switch the output; refused while a trip is latched."""
        if on and self.trips:
            raise SettingRefused(-221, f"output stays off while {','.join(self.trips)} is latched")
        self.output_on = on

    def trip(self, name: str) -> None:
        """Latch a protection and cut the output."""
        if name not in self.trips:
            self.trips.append(name)
        self.output_on = False

    def clear_trips(self) -> None:
        """Unlatch; the output stays off."""
        self.trips.clear()

    @property
    def effective_ocp_A(self) -> float:
        """The level that trips, infinite where the protection is off."""
        return self.ocp_A if self.ocp_on else inf

    @property
    def effective_ovp_V(self) -> float:
        """As :attr:`effective_ocp_A`."""
        return self.ovp_V if self.ovp_on else inf

    def heard(self, time_s: float) -> None:
        """A command arrived at bench time ``time_s``: the watchdog counts from here."""
        self.last_command_s = time_s

    @property
    def watchdog_expires_s(self) -> float:
        """Bench time at which the watchdog will cut, infinite where it will not."""
        return self.last_command_s + self.watchdog_delay_s if self.watchdog_on and self.output_on else inf


def _ranged(value: float, limits: tuple[float, float], unit: str) -> float:
    if not limits[0] <= value <= limits[1]:
        raise SettingRefused(-222, f"{value:g} {unit} is outside {limits[0]:g} to {limits[1]:g} {unit}")
    return float(value)
