"""What speaks for or against an effect, a file for each: what it finds in logs, how far off that is, and what is usual.

* :mod:`.residual`: the displacement all along, against what the calibration lets expect of the model's error;
* :mod:`.rest`: resistance and displacement where the wire stands still, against the calibration's;
* :mod:`.spring`: the load against the displacement, where the wire pulls a spring, which is straight;
* :mod:`.power`: the power that it takes to transform the wire, against the calibration's heat balance.
"""

from .power import Power
from .residual import Residual
from .rest import Rests
from .spring import Springs
from .witness import Witness, limited

#: Beside the displacement all along, in the order of their rows.
WITNESSES = (*Rests.names, *Springs.names, *Power.names)

__all__ = ["WITNESSES", "Power", "Residual", "Rests", "Springs", "Witness", "limited"]
