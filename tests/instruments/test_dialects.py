"""Every dialect that comes with the package: complete, and saying exactly what the manual has."""

from importlib.metadata import EntryPoint

import pytest
import yaml
from families import FAMILIES
from stand_in_server import ScpiStandIn

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.plug_ins import PlugInError
from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentRefused, dialect, open_daq, open_supply
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.instruments.dialect import FOLDER, GROUP, Dialect
from sma_actuator.instruments.phrases import Query, yes

SHIPPED = sorted((path.stem, yaml.safe_load(path.read_text())["kind"]) for path in FOLDER.glob("*.yaml"))

#: Identity, then the lines of opening with channel 2, driving 0.123 A, reading back and shutting down.
SUPPLIES = {
    "keysight_n6700": (
        "Keysight Technologies,N6700C,MY123,D.01.08",
        [
            "OUTP OFF,(@2)",
            "CURR 0.00000,(@2)",
            "*IDN?",
            "*CLS",
            "OUTP OFF,(@2)",
            "OUTP:PROT:CLE (@2)",
            "CURR 0.00000,(@2)",
            "VOLT 0.0000,(@2)",
            "VOLT:PROT 6.600,(@2)",
            "VOLT 6.0000,(@2)",
            "OUTP:PROT:WDOG:DEL 1",
            "OUTP:PROT:WDOG ON",
            "SYST:ERR?",
            "OUTP? (@2)",
            "VOLT? (@2)",
            "VOLT:PROT? (@2)",
            "OUTP:PROT:WDOG?",
            "OUTP:PROT:WDOG:DEL?",
            "CURR 0.12300,(@2)",
            "OUTP ON,(@2)",
            "CURR? (@2)",
            "OUTP? (@2)",
            "MEAS:VOLT? (@2)",
            "MEAS:CURR? (@2)",
            "OUTP OFF,(@2)",
            "CURR 0.00000,(@2)",
            "OUTP? (@2)",
        ],
    ),
    "keithley_2260b": (
        "KEITHLEY,2260B-30-36,1405537,1.72",
        [
            "OUTP OFF",
            "SOUR:CURR 0.0000",
            "*IDN?",
            "*CLS",
            "SYST:COMM:RLST REM",
            "OUTP OFF",
            "OUTP:PROT:CLE",
            "SOUR:CURR 0.0000",
            "SOUR:VOLT 0.000",
            "SOUR:VOLT:PROT 6.600",
            "SOUR:CURR:PROT 0.450",
            "SOUR:CURR:PROT:STAT ON",
            "SOUR:VOLT 6.000",
            "SYST:ERR?",
            "OUTP?",
            "SOUR:VOLT?",
            "SOUR:VOLT:PROT?",
            "SOUR:CURR:PROT?",
            "SOUR:CURR:PROT:STAT?",
            "SOUR:CURR 0.1230",
            "OUTP ON",
            "SOUR:CURR?",
            "OUTP?",
            "MEAS:VOLT?",
            "MEAS:CURR?",
            "SOUR:VOLT:PROT:TRIP?",
            "SOUR:CURR:PROT:TRIP?",
            "OUTP OFF",
            "SOUR:CURR 0.0000",
            "OUTP?",
        ],
    ),
    "rigol_dp800": (
        "RIGOL TECHNOLOGIES,DP832,DP8C1234567,00.01.16",
        [
            ":OUTP CH2,OFF",
            ":SOUR2:CURR 0.0000",
            "*IDN?",
            "*CLS",
            ":SYST:REM",
            ":SYST:RWL",
            ":OUTP CH2,OFF",
            ":OUTP:OVP:CLEAR CH2",
            ":OUTP:OCP:CLEAR CH2",
            ":SOUR2:CURR 0.0000",
            ":SOUR2:VOLT 0.000",
            ":OUTP:OVP:VAL CH2,6.600",
            ":OUTP:OVP CH2,ON",
            ":OUTP:OCP:VAL CH2,0.4500",
            ":OUTP:OCP CH2,ON",
            ":SOUR2:VOLT 6.000",
            ":SYST:ERR?",
            ":OUTP? CH2",
            ":SOUR2:VOLT?",
            ":OUTP:OVP:VAL? CH2",
            ":OUTP:OVP? CH2",
            ":OUTP:OCP:VAL? CH2",
            ":OUTP:OCP? CH2",
            ":SOUR2:CURR 0.1230",
            ":OUTP CH2,ON",
            ":SOUR2:CURR?",
            ":OUTP? CH2",
            ":MEAS:VOLT? CH2",
            ":MEAS:CURR? CH2",
            ":OUTP:OVP:QUES? CH2",
            ":OUTP:OCP:QUES? CH2",
            ":OUTP CH2,OFF",
            ":SOUR2:CURR 0.0000",
            ":OUTP? CH2",
        ],
    ),
}
DAQS = {
    "keithley_2000": (
        "KEITHLEY INSTRUMENTS INC.,MODEL 2000,0842543,A20  /A02",
        [
            "*IDN?",
            "*CLS",
            "INIT:CONT OFF",
            "ROUT:SCAN:LSEL NONE",
            "SENS:FUNC 'VOLT:DC'",
            "SENS:VOLT:DC:RANG 10",
            "FORM:ELEM READ",
            "TRIG:SOUR IMM",
            "TRIG:COUN 1",
            "SAMP:COUN 6",
            "ROUT:SCAN (@101,102,103)",
            "ROUT:SCAN:LSEL INT",
            "SYST:ERR?",
            "READ?",
        ],
    ),
    "keysight_daq970a": (
        "Keysight Technologies,DAQ970A,MY58000001,A.03.01",
        [
            "*IDN?",
            "*CLS",
            "CONF:VOLT:DC 10,(@101,102,103)",
            "ROUT:SCAN (@101,102,103)",
            "TRIG:SOUR IMM",
            "TRIG:COUN 2",
            "FORM:READ:TIME OFF",
            "FORM:READ:CHAN OFF",
            "FORM:READ:ALAR OFF",
            "FORM:READ:UNIT OFF",
            "SYST:ERR?",
            "READ?",
        ],
    ),
    "keithley_2700": (
        "KEITHLEY INSTRUMENTS INC.,MODEL 2701,1074832,A09  /A02",
        [
            "*IDN?",
            "*CLS",
            "INIT:CONT OFF",
            "ROUT:SCAN:LSEL NONE",
            "FORM:ELEM READ",
            "SENS:FUNC 'VOLT',(@101,102,103)",
            "SENS:VOLT:RANG 10,(@101,102,103)",
            "TRIG:SOUR IMM",
            "TRIG:COUN 1",
            "SAMP:COUN 6",
            "ROUT:SCAN (@101,102,103)",
            "ROUT:SCAN:TSO IMM",
            "ROUT:SCAN:LSEL INT",
            "SYST:ERR?",
            "READ?",
        ],
    ),
    "keithley_daq6510": (
        "KEITHLEY INSTRUMENTS,MODEL DAQ6510,04340543,1.7.12",
        [
            "*IDN?",
            "*CLS",
            'SENS:FUNC "VOLT:DC",(@101,102,103)',
            "SENS:VOLT:RANG 10,(@101,102,103)",
            "ROUT:SCAN:CRE (@101,102,103)",
            "ROUT:SCAN:COUN:SCAN 2",
            "SYST:ERR?",
            'TRAC:CLE "defbuffer1"',
            "INIT",
            "*WAI",
            'TRAC:DATA? 1,6,"defbuffer1",READ',
        ],
    ),
}


@pytest.mark.parametrize(("name", "kind"), SHIPPED)
def test_every_shipped_dialect_loads_and_cites_its_source(name, kind):
    assert Dialect.load(name, kind).family
    assert yaml.safe_load((FOLDER / f"{name}.yaml").read_text())["source"]


def test_every_real_family_is_tested_below_or_against_an_emulator():
    assert {name for name, _ in SHIPPED if not name.startswith(("virtual_bench", "rp2040_board"))} == {
        *SUPPLIES,
        *DAQS,
        *FAMILIES,
    }


@pytest.mark.parametrize("name", SUPPLIES)
def test_a_supply_hears_its_manuals_commands_and_no_other(make_config, name):
    identity, expected = SUPPLIES[name]
    server = ScpiStandIn(
        {"*IDN?": identity, "SYST:ERR?": '0,"No error"', ":SYST:ERR?": '0,"No error"', "OUTP:PROT:WDOG?": "1"}
    )
    try:
        if "OUTP:PROT:WDOG:DEL?" in expected:
            server.replies["OUTP:PROT:WDOG:DEL?"] = "1"
        config = Config.from_mapping(
            make_config(
                **{
                    "instruments": {"supply": {"resource": server.resource, "dialect": name, "channel": 2}},
                    "supply.allow_no_watchdog": name != "keysight_n6700",
                    "supply.watchdog_timeout": 1.0 if name == "keysight_n6700" else 0.0,
                    "supply.allow_single_session": name != "keysight_n6700",
                    "supply.allow_shared_watchdog": name == "keysight_n6700",
                    "supply.allow_no_trips": name == "keysight_n6700",
                }
            )
        )
        supply = open_supply(config)
        supply.open()
        supply.set_current(0.123)
        supply.set_output(True)
        state = supply.read_back()
        supply.shut_down()
        heard = list(server.lines)
        supply.close()
        assert heard == expected
        assert state.current_setting_A == pytest.approx(0.123)
        assert state.output_on
        assert state.tripped == ""
    finally:
        server.close()


@pytest.mark.parametrize("name", DAQS)
def test_a_daq_hears_its_manuals_commands_and_its_raw_readings_are_averaged(make_config, name):
    identity, expected = DAQS[name]
    server = ScpiStandIn({"*IDN?": identity, "SYST:ERR?": '0,"No error"', expected[-1]: "1.0,0.10,0.5,1.2,0.12,0.7"})
    try:
        changes = {"instruments": {"daq": {"resource": server.resource, "dialect": name}}, "loop.samples_per_block": 2}
        daq = open_daq(Config.from_mapping(make_config(**changes)), MonotonicClock())
        daq.open()
        reading = daq.read_block()
        daq.close()
        assert server.lines == expected
        assert (reading.supply_voltage_V, reading.reference_voltage_V, reading.load_cell_voltage_V) == pytest.approx(
            (1.1, 0.11, 0.6)
        )
        assert reading.lvdt_current_A != reading.lvdt_current_A  # no such channel: NaN
    finally:
        server.close()


@pytest.mark.parametrize("name", DAQS)
def test_a_daq_that_reads_volts_is_refused_an_ambient_temperature_channel(make_config, name):
    server = ScpiStandIn({"*IDN?": DAQS[name][0], "SYST:ERR?": '0,"No error"'})
    try:
        changes = {
            "instruments": {"daq": {"resource": server.resource, "dialect": name, "ambient_temperature_channel": 105}}
        }
        with pytest.raises(
            InstrumentRefused,
            match=f"ambient_temperature_channel: is 105, but dialect '{name}' reads every channel in volts",
        ):
            open_daq(Config.from_mapping(make_config(**changes)), MonotonicClock()).open()
    finally:
        server.close()


def test_a_supply_without_watchdog_is_refused_unless_that_is_accepted(make_config):
    server = ScpiStandIn({"*IDN?": SUPPLIES["keithley_2260b"][0], "SYST:ERR?": '0,"No error"'})
    try:
        config = Config.from_mapping(
            make_config(instruments={"supply": {"resource": server.resource, "dialect": "keithley_2260b"}})
        )
        with pytest.raises(InstrumentRefused, match="has no communication watchdog.*supply.allow_no_watchdog"):
            open_supply(config).open()
        assert "OUTP ON" not in server.lines
    finally:
        server.close()


def test_the_over_voltage_trip_is_a_tenth_above_unless_it_is_said(make_config):
    supply = Config.from_mapping(make_config(**{"supply.max_voltage": 5.0})).supply
    assert supply.over_voltage_V == pytest.approx(5.5)
    supply = Config.from_mapping(make_config(**{"supply.max_voltage": 5.0, "supply.over_voltage_trip": 8.0})).supply
    assert supply.over_voltage_V == 8.0
    with pytest.raises(ConfigError, match="over_voltage_trip: 5 V is not above supply.max_voltage, 5 V"):
        Config.from_mapping(make_config(**{"supply.max_voltage": 5.0, "supply.over_voltage_trip": 5.0}))


def test_a_daq_that_is_not_told_its_channels_is_refused(tmp_path):
    document = yaml.safe_load((FOLDER / "virtual_bench_daq.yaml").read_text())
    document["commands"]["prepare"] = "ROUT:SCAN (@101)"
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
    wanted = r"prepare, .*read: one with the placeholder \{channels\} is wanted; .*\{channel\}, .* queries.read.columns"
    with pytest.raises(ConfigError, match=wanted):
        Dialect.load(str(tmp_path / "mine.yaml"), "daq")
    document["queries"]["read"] = {"ask": "r", "columns": 8}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
    Dialect.load(str(tmp_path / "mine.yaml"), "daq")
    document["commands"]["prepare"] = "ROUT:SCAN (@{channels})"  # what is told its channels answers with these
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(ConfigError, match=wanted):
        Dialect.load(str(tmp_path / "mine.yaml"), "daq")


@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
def test_a_converter_that_takes_its_channels_with_each_reading_needs_no_preparation(tmp_path, mark):
    read = {"ask": "r {channels} {samples}", "scale": 0.001, "separator": mark}
    document = {"kind": "daq", "queries": {"identity": None, "read": read}}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
    dialect = Dialect.load(str(tmp_path / "mine.yaml"), "daq")
    queries, _ = dialect.asked(channels="1,2,3", samples=4, readings=12)
    assert queries["read"].text == "r 1,2,3 4"
    assert queries["read"].numbers(mark.join(["1500.0", "-2.5", "0"])) == pytest.approx([1.5, -0.0025, 0.0])
    assert Query("r").numbers("1,2") == [1.0, 2.0]
    read["separator"] = "ab"
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(ConfigError, match="queries.read.separator: 'ab'; one of ',', ';', .* is wanted"):
        Dialect.load(str(tmp_path / "mine.yaml"), "daq")


def test_a_daq_that_neither_measures_celsius_nor_not_is_refused(tmp_path):
    document = yaml.safe_load((FOLDER / "virtual_bench_daq.yaml").read_text())
    document["measures_celsius"] = "no"
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(ConfigError, match="measures_celsius: 'no' is neither true nor false"):
        Dialect.load(str(tmp_path / "mine.yaml"), "daq")


def test_a_file_that_is_no_text_is_refused_in_a_sentence(tmp_path):
    (tmp_path / "mine.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="mine.yaml: is not text"):
        Dialect.load(str(tmp_path / "mine.yaml"), "supply")


def test_an_unknown_dialect_names_its_neighbour():
    with pytest.raises(ConfigError, match="did you mean keithley_2260b"):
        Dialect.load("keithley_2260", "supply")


@pytest.mark.parametrize(
    ("change", "words"),
    (
        (lambda d: d["commands"].pop("output_off"), "commands.output_off: missing"),
        (lambda d: d["queries"].pop("current"), "queries.current: missing"),
        (lambda d: d["queries"].pop("output"), "queries.output: missing"),
        (lambda d: d["commands"].update(output_onn="OUTP ON"), "commands.output_onn: no such entry"),
        (lambda d: d["commands"].update(set_current="CURR {valeu}"), r"commands.set_current: .*placeholder \{valeu\}"),
        (lambda d: d["commands"].update(set_current="CURR {value"), "commands.set_current: .*cannot be filled in"),
        (
            lambda d: d["commands"].update(set_current=["CURR {value", "CURR {valeu}"]),
            r"(?s)cannot be filled in.*placeholder \{valeu\}",
        ),
        (lambda d: d["queries"].pop("watchdog_armed"), "a watchdog that cannot be read back is none"),
        (lambda d: d.update(identity="("), "identity: a regular expression"),
        (lambda d: d.update(kind="daq"), "is not a dialect of kind 'supply'"),
        (lambda d: d.update(trips={"OOPS": "X?"}), "trips.OOPS: no such trip"),
        (lambda d: d["commands"].update(clear_trips=7), "commands.clear_trips: 7 is neither"),
        (
            lambda d: d["commands"].update(set_current="CURR 0.4"),
            r"commands.set_current: 'CURR 0.4' has no placeholder \{value\}",
        ),
        (
            lambda d: d["commands"].update(set_current="CURR {value:9999999999999f}"),
            "set_current: .* is no way to write a",
        ),
        (
            lambda d: d["commands"].update(set_current="CURR {value:.999999999f}"),
            "set_current: .* is no way to write a",
        ),
        (lambda d: d["commands"].update(set_current="CURR {value:{nothing}}"), "set_current: .* is no way to write a"),
        (lambda d: d.update(identity="a{99999999999999}"), "identity: a regular expression"),
        (lambda d: d.update(identity="(" * 5000), "identity: a regular expression"),
        *(
            (
                lambda d, way=way: d["commands"].update(set_current=f"CURR {{value{way}}},(@{{channel}})"),
                r"set_current: '\{value:.*\}' is no way to write a",
            )
            for way in (":.4q", ":%", ":,", ":_", ":n", "!r", "!a:>9", ":*^9", ":٣", ":s")
        ),
        (
            lambda d: d["commands"].update(set_current="CURR {value:.4f}\nOUTP ON"),
            "set_current: .* holds what cannot be printed",
        ),
        (lambda d: d["commands"].update(clear_trips=["CLE", 7]), "commands.clear_trips: .* is neither"),
        (lambda d: d["commands"].update(clear_trips=["CLE", ""]), "commands.clear_trips: .* is neither"),
        (lambda d: d.pop("queries"), "queries: missing; a section of texts"),
        (lambda d: d["queries"].update(current=["A?", "B?"]), "queries.current: .* has 2 texts; a query has one"),
        (lambda d: d.update(trips=["OVP"]), "trips: .* is no section of queries"),
        (lambda d: d.update(trips={"OVP": 5}), "trips.OVP: 5 is not a text"),
        (lambda d: d.pop("watchdog_fed_by"), "watchdog_fed_by: session, .* or anyone is wanted"),
        (lambda d: d.update(second_session="yes"), "second_session: 'yes' is neither true nor false"),
        (lambda d: d.update(watchdog_range_s=5), "watchdog_range_s: 5 is not shortest and longest"),
        (lambda d: d.update(watchdog_range_s=[3600, 1]), "watchdog_range_s: .* is not shortest and longest"),
        (lambda d: d.update(watchdog_range_s=[-0.5, 1]), "watchdog_range_s: .* is not shortest and longest"),
        (lambda d: d.update(watchdog_step_s=-0.5), "watchdog_step_s: -0.5 is not a number"),
        (lambda d: d.update(watchdog_step_s="one"), "watchdog_step_s: 'one' is not a number"),
        (lambda d: d.update(chained_queries="no"), "chained_queries: 'no' is neither true nor false"),
        (lambda d: d.update(termination="LF"), "termination: 'LF' ends no line"),
        (lambda d: d.update(termination=""), "command_pause: missing; where nothing ends a line"),
        (lambda d: d.update(command_pause="long"), "command_pause: 'long' is not the least time between its lines"),
        (
            lambda d: d["queries"].update(current={"ask": "A?", "length": 0}),
            "queries.current.length: 0; how many characters .* is wanted",
        ),
        (
            lambda d: d["queries"].update(current={"ask": "A?", "length": 5, "bytes": 5}),
            "queries.current: length is of a text and bytes of a number; one of them is wanted",
        ),
        (
            lambda d: d["queries"].update(current={"ask": "A?", "length": 5}),
            "queries.identity: null is wanted where answers have no end",
        ),
        (
            lambda d: (
                d.pop("identity"),
                d["queries"].update(identity=None, current={"ask": "A?", "length": 5}),
            ),
            "queries .*voltage.*: length is wanted of each where current has it",
        ),
        (lambda d: d.update(answer_termination=";"), "answer_termination: ';' ends no line"),
        (lambda d: d.update(answer_termination=" "), "answer_termination: ' ' ends no line"),
        (lambda d: d.update(acknowledgement="("), r"acknowledgement: '\('; a regular expression for the whole line"),
        (lambda d: d.update(acknowledgement="(O+)+"), "acknowledgement: .*, in quotes: what is repeated in it varies"),
        (
            lambda d: d.update(identity="(A+)+"),
            "identity: a regular expression .* is wanted: what is repeated in it varies",
        ),
        (lambda d: d.update(identity="A.*B.*C.*D"), "identity: .* is wanted: it has 3 repetitions .*; 2 at the most"),
        (
            lambda d: d["queries"].update(current={"ask": "A?", "answer": "((a+)+)"}),
            "queries.current.answer: .* is wanted: what is repeated in it varies",
        ),
        (lambda d: d.update(zero_current="1 mA"), "zero_current: '1 mA' is not the least current"),
        (lambda d: d.update(zero_current=-0.1), "zero_current: -0.1 is not the least current"),
        (lambda d: d.update(measures_while_off=0), "measures_while_off: 0 is neither true nor false"),
        (lambda d: d.update(off_resets="no"), "off_resets: 'no' is neither true nor false"),
        (lambda d: d["queries"].update(identity=None), "identity: nothing is asked that could be held against it"),
        (lambda d: d["queries"].update(identity="ID?", current=None), "queries.current: missing"),
        (lambda d: d["commands"].update(set_current={"tell": "CURR 1"}), r"no placeholder \{value\}"),
        (
            lambda d: d["commands"].update(set_current={"say": "CURR {value}"}),
            "set_current.say: no such entry; known are",
        ),
        (
            lambda d: d["commands"].update(set_current={"tell": "I {value}", "scale": 0}),
            "set_current.scale: 0 is not a",
        ),
        (lambda d: d["commands"].update(set_current={"tell": "I {value}", "scale": "m"}), "scale: 'm' is not a number"),
        (lambda d: d["queries"].update(current={"answer": "(.*)A"}), "queries.current: None is not a text"),
        (
            lambda d: d["queries"].update(current={"ask": "I?", "answer": ".*A"}),
            "current.answer: '.*A' has not one group",
        ),
        (
            lambda d: d["queries"].update(current={"ask": "I?", "answer": "(.*A"}),
            "a regular expression for the whole line",
        ),
        (
            lambda d: d["queries"].update(current={"ask": "I?", "field": 0}),
            "current.field: 0; the number of a field, from 1",
        ),
        (lambda d: d["queries"].update(current={"ask": "I?", "base": 8}), "current.base: 8; 10 or 16 is wanted"),
        (
            lambda d: d["queries"].update(current={"ask": "I?", "scale": 0}),
            "current.scale: 0; a number that is not zero",
        ),
        (
            lambda d: d["queries"].update(current={"ask": "I?", "mask": 1}),
            "current.mask: no such entry here; known are ask, answer",
        ),
        (lambda d: d["queries"].update(output={"ask": "O?", "mask": True}), "output.mask: True; the value of a bit"),
        (lambda d: d["queries"].update(output={"ask": "O?", "mask": {1: "a"}}), "output.mask: .*; the value of a bit"),
        (lambda d: d["queries"].update(output={"ask": "O?", "mask": {}}), "output.mask: {}; the value of a bit"),
        (lambda d: d["queries"].update(output={"ask": "O?", "scale": 2}), "output.scale: no such entry here"),
        (
            lambda d: d["queries"].update(output={"ask": "O?", "yes": "CC|CV"}),
            "queries.output: yes and no are wanted together",
        ),
        (
            lambda d: d["queries"].update(output={"ask": "O?", "yes": True, "no": "0"}),
            "yes: True; a regular expression, in quotes",
        ),
        (lambda d: d.update(identity=""), "identity: .*lets any instrument pass"),
    ),
)
def test_a_faulty_dialect_is_refused_in_a_sentence_with_its_file(tmp_path, change, words):
    document = yaml.safe_load((FOLDER / "virtual_bench_supply.yaml").read_text())
    change(document)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(ConfigError, match=words) as caught:
        Dialect.load(str(path), "supply")
    assert str(path) in str(caught.value)


def test_every_mistake_of_a_file_is_named_at_once(tmp_path):
    document = yaml.safe_load((FOLDER / "virtual_bench_daq.yaml").read_text())
    document["commands"] = {"prepair": "A", "prepare": 7, "before_reed": "B"}
    document["queries"]["error"] = "ERR? {channels}"
    document["queries"]["reed"] = "READ?"
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    with pytest.raises(ConfigError) as caught:
        Dialect.load(str(path), "daq")
    for words in (
        "commands.prepair: no such entry",
        "commands.prepare: 7 is neither",
        "commands.before_reed: no such entry",
        "queries.error: 'ERR? {channels}' has the placeholder {channels}; allowed are none",
        "queries.reed: no such entry",
    ):
        assert words in str(caught.value)


@pytest.mark.parametrize("span", ([0, 60], [5, 5]))
def test_a_watchdog_may_have_one_delay_or_begin_at_none(tmp_path, span):
    document = yaml.safe_load((FOLDER / "virtual_bench_supply.yaml").read_text())
    document["watchdog_range_s"] = span
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
    assert Dialect.load(str(tmp_path / "mine.yaml"), "supply").watchdog_range_s == tuple(span)


def test_another_package_brings_a_dialect_by_its_name(tmp_path, monkeypatch):
    package = tmp_path / "bringer_of_dialects"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "mine.yaml").write_text((FOLDER / "virtual_bench_supply.yaml").read_text())
    monkeypatch.syspath_prepend(str(tmp_path))
    points = [EntryPoint(name, package.name, GROUP) for name in ("mine", "forgotten")]
    monkeypatch.setattr(dialect, "entry_points", lambda group: points)
    assert Dialect.load("mine", "supply").path == package / "mine.yaml"
    with pytest.raises(PlugInError, match="wants the file .*forgotten.yaml, which is not there"):
        Dialect.load("forgotten", "supply")
    with pytest.raises(ConfigError, match="did you mean mine"):
        Dialect.load("mien", "supply")


@pytest.mark.parametrize(
    ("reply", "on"),
    [("1", True), ("0", False), ("ON", True), ("off", False), ("+1", True), ("1.000000E+00", True), ("0.0", False)]
    + [('"ON"', True)]
    + [(words, None) for words in ("", "2", "nan", "1A", "inf", "-", "0x1")],
)
def test_a_supply_may_say_on_and_off_as_words_or_as_any_scpi_number(reply, on):
    if on is None:
        with pytest.raises(ValueError, match="neither on nor off"):
            yes(reply)
    else:
        assert yes(reply) is on


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("virtual_bench_supply", {"voltage_setting", "over_current_trip", "watchdog_trip"}),
        ("keithley_2260b", {"voltage_setting", "over_current_trip"}),
        ("keysight_n6700", {"voltage_setting"}),
    ],
)
def test_what_a_family_reads_back_is_what_its_dialect_asks(make_config, name, told):
    config = Config.from_mapping(make_config(**{"instruments.supply.dialect": name}))
    assert open_supply(config).reads_back == told
