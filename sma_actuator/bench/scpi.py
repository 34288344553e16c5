"""The SCPI of the two virtual instruments: what they understand and how they answer.

A line ends with ``\\n``; commands are chained with ``;`` and their answers come joined by ``;`` on
one line.  Long and short forms, upper and lower case are accepted; a header after ``;`` that does
not begin with ``:`` or ``*`` is first taken below the path of the one before it, as SCPI has it,
and then from the root.  Numbers may carry a unit (``0.4A``, ``400mA``); ``MIN``, ``MAX`` and ``DEF`` stand for
numbers wherever a range is given.  What cannot be obeyed goes to the error queue (20 deep) and
gives no answer.  Optional parts are in brackets.

Both instruments
    ============================================= ===================================================
    ``*IDN?``                                     ``SMA Actuator,Virtual Supply,<serial>,<version>``
                                                  or ``SMA Actuator,Virtual DAQ,<serial>,<version>``
    ``*RST``                                      settings as at power-on (supply: output off, 0 A)
    ``*CLS``                                      empties the error queue and the event register
    ``*OPC`` ``*OPC?`` ``*WAI``                   operations are complete at once: ``1``
    ``*ESR?`` ``*STB?`` ``*ESE n`` ``*ESE?``      IEEE 488.2 status
    ``*TST?``                                     ``0``
    ``SYSTem:ERRor[:NEXT]?``                      oldest error, ``-113,"Undefined header"``; else ``0,"No error"``
    ``SYSTem:VERSion?``                           ``1999.0``
    ============================================= ===================================================

Supply (one output, 0–1 A, 0–20 V)
    ============================================= ===================================================
    ``[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude] <A>``   current setting; ``?`` reads it back
    ``[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude] <V>``   compliance voltage; ``?``
    ``[SOURce:]CURRent:PROTection[:LEVel] <A>``   over-current trip, 0.01–1.2 A; ``?``
    ``[SOURce:]CURRent:PROTection:STATe <bool>``  ``?`` ``1``/``0`` (power-on: on)
    ``[SOURce:]CURRent:PROTection:TRIPped?``      ``1`` when it has tripped
    ``[SOURce:]VOLTage:PROTection[:LEVel] <V>``   over-voltage trip, 0.1–22 V; ``?``
    ``[SOURce:]VOLTage:PROTection:STATe <bool>``  ``?`` (power-on: on)
    ``[SOURce:]VOLTage:PROTection:TRIPped?``
    ``OUTPut[:STATe] <bool>``                     output; ``?`` ``1``/``0``.  Refused with
                                                  ``-221,"Settings conflict"`` while a trip is latched
    ``OUTPut:PROTection:TRIPped?``                ``NONE``, or of ``OVP,OCP,OTP,WDOG``, comma-joined
    ``OUTPut:PROTection:CLEar``                   clears latched trips; the output stays off
    ``OUTPut:PROTection:WDOG[:STATe] <bool>``     communication watchdog; ``?``.  It counts from the last
                                                  command received on any connection; then it latches
                                                  WDOG and cuts the output
    ``OUTPut:PROTection:WDOG:DELay <s>``          0.05–3600 s; ``?``
    ``MEASure[:SCALar]:VOLTage[:DC]?``            at the output terminals [V]
    ``MEASure[:SCALar]:CURRent[:DC]?``            [A]
    ``MEASure[:SCALar]:POWer[:DC]?``              [W]
    ``STATus:OPERation:CONDition?``               bit 8 (256) constant voltage, bit 10 (1024) constant current
    ``STATus:QUEStionable:CONDition?``            bit 0 OVP, 1 OCP, 4 OTP, 11 WDOG
    ``SYSTem:REMote`` ``SYSTem:LOCal``            remote, or front panel as well
    ``SYSTem:RWLock``                             exclusive: settings from any other connection are refused with
                                                  ``-203,"Command protected"`` until ``SYST:LOC`` or the owner's
                                                  connection closes
    ``SYSTem:LOCK:OWNer?``                        ``NONE``, ``SELF`` or ``OTHER``
    ============================================= ===================================================

DAQ (1 kHz simultaneous sampling, 16 bit, ±10 V)
    ============================================= ===================================================
    ``ROUTe:SCAN (@101,102,103:105)``             channel list; ``?``.  101 net voltage, 102 sense resistor,
                                                  103 load cell, 104 LVDT shunt, 105 ambient [°C]
    ``SAMPle:COUNt <1..5000>``                    samples per block; ``?``
    ``SAMPle:RATE?``                              ``1000``
    ``FORMat:READing:TIME <bool>``                first field of every row is the time stamp [s] on the
                                                  DAQ's clock, at the end of the block (or sample); ``?`` (power-on: on)
    ``FETCh:AVERage?``                            mean of the newest block: ``time,v1,v2,…`` in scan order.
                                                  ``-230,"Data corrupt or stale"`` while fewer samples exist than asked
    ``FETCh[:RAW]?``                              the newest block, sample after sample: ``t1,v11,v12,…,t2,v21,…``
    ``READ:AVERage?`` ``READ[:RAW]?``             the same of a block that begins now (answers when it is full)
    ``SYSTem:TIME:ELAPsed?``                      the DAQ's clock [s]
    ============================================= ===================================================
    A saturated channel reads ``9.90000000E+37``, a failed one ``NAN``.

The test stand itself (either port; no real instrument has these)
    ============================================= ===================================================
    ``BENCh:FAULt <name>[,<value>]``              misbehave (:data:`~sma_actuator.bench.faults.FAULTS`); ``?`` lists those active
    ``BENCh:FAULt:CLEar [<name>]``                one of them, or all
    ``BENCh:FAULt:CATalog?``                      the names
    ``BENCh:LOAD:WEIGht <N>``                     hang a weight
    ``BENCh:LOAD:SPRing <N/m>,<N>[,<m>]``         a spring: stiffness, tension, and the displacement where it has it
    ``BENCh:LOAD:SCHedule <s>,<N>{,<s>,<N>}``     weights from bench times on
    ``BENCh:LOAD?``                               the load in words
    ``BENCh:AMBient <°C>``                        ``?``
    ``BENCh:TRUTh?``                              time_s, displacement_m, strain, temperature_C, martensite, r_phase,
                                                  resistance_Ohm, load_N, stress_Pa, current_A, power_W
    ============================================= ===================================================
"""
