"""A wire whose heat is known, in round numbers."""

from sma_actuator.base.calibration import Calibration, HotEndSection, PowerSection, RestSection

#: At 100 MPa and 4.0 Ω contracted, 5.0 Ω cold; 80 °C contracted, 60 °C cold, and 10 K more by the stress.
CALIBRATION = Calibration(
    ambient_temperature=20.0,
    rest=RestSection(cold_stress=(1e8,), cold_resistance=(5.0,), cold_displacement=(0.004,)),
    hot_end=HotEndSection(contracted_stress=(1e8,), contracted_resistance=(4.0,), contracted_displacement=(0.0,)),
    power=PowerSection(
        transformation_heating=(80.0, 60.0),
        transformation_cooling=(50.0, 40.0),
        transformation_shift=(3e-7, 1e-7),
        latent_rise=20.0,
    ),
)
