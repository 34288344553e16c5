"""A supply that is as plain as one can be, and its dialect, for what a single entry changes."""

import yaml

LEFT_OUT = object()


class Answering:
    """Remembers what it was told, and answers every command with ``acknowledgement``, or with nothing."""

    identity = "MAKER,ANSWERING 1,7,1.0"

    def __init__(self, acknowledgement="OK"):
        self.acknowledgement = acknowledgement
        self.settings = {"OUTP": "0", "CURR": "0", "VOLT": "0"}
        self.refused = ()  #: headers that it does not take

    def __call__(self, line):
        header, _, value = line.partition(" ")
        if line == "*IDN?":
            return self.identity
        if header.startswith("MEAS:"):
            return "0.5" if self.settings["OUTP"] == "1" else "0"
        if header.endswith("?"):
            return self.settings.get(header[:-1], "0")
        if header in self.refused:
            return "E04"
        self.settings[header] = value
        return self.acknowledgement


def dialect(tmp_path, **changes):
    """Path of a file for it; a change may name an entry of a section, as ``queries.output``, or be LEFT_OUT."""
    document = {
        "kind": "supply",
        "identity": "ANSWERING",
        "commands": {
            "output_on": "OUTP 1",
            "output_off": "OUTP 0",
            "set_current": "CURR {value:.3f}",
            "set_voltage": "VOLT {value:.3f}",
        },
        "queries": {
            "output": "OUTP?",
            "current_setting": "CURR?",
            "voltage_setting": "VOLT?",
            "voltage": "MEAS:VOLT?",
            "current": "MEAS:CURR?",
        },
    }
    for name, value in changes.items():
        section, _, entry = name.rpartition(".")
        place = document[section] if section else document
        place[entry] = value
        if value is LEFT_OUT:
            del place[entry]
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
    return str(tmp_path / "mine.yaml")
