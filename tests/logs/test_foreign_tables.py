"""Tables as loggers and spreadsheets of many countries write them: the same numbers come out, or one sentence says what
is wrong where."""

import datetime
import re

import numpy as np
import pytest

from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.fields import decimal_mark
from sma_actuator.logs.formats import read_table
from sma_actuator.logs.mapping import column_map
from sma_actuator.logs.reading import ReadingOptions, read_logs

NAMES = ["Zeit [s]", "Widerstand [Ohm]", "Strom [A]", "Kraft [N]", "Weg [mm]"]
N = 60
TIME_s = np.arange(N) * 0.05
ROWS = np.column_stack(
    (TIME_s, 6.0 + 0.5 * np.sin(TIME_s), 0.05 + 0.3 * (TIME_s > 1), 0.98 + 0 * TIME_s, 3 + np.cos(TIME_s))
)
BEGUN = datetime.datetime(2026, 3, 31, 23, 59, 58)


def comma(value, decimals=5):
    return f"{value:.{decimals}f}".replace(".", ",")


def point(value):
    return f"{value:.5f}"


def lines(separator=";", number=comma, names=NAMES, rows=ROWS):
    return [separator.join(names), *(separator.join(map(number, row)) for row in rows)]


def stamped(stamp):
    """The times as dates, with midnight among them."""
    out = lines(names=["Zeit", *NAMES[1:]])
    for i, time_s in enumerate(TIME_s):
        moment = BEGUN + datetime.timedelta(seconds=float(time_s))
        out[i + 1] = stamp(moment) + ";" + out[i + 1].partition(";")[2]
    return out


def thousands(value, mark=".", decimal=","):
    return f"{value:,.4f}".replace(",", "_").replace(".", decimal).replace("_", mark)


PROTOCOL = ["Messprotokoll Draht 7", "Draht 0,15 mm, Länge 0,1 m", "Bediener;Meier", "Rate [Hz];20,0", ""]
LABVIEW = [
    "LabVIEW Measurement\t",
    "Separator\tTab",
    "Decimal_Separator\t,",
    "***End_of_Header***\t",
    "\t",
    "Channels\t4\t\t\t\t\t",
    "Date\t2026/03/31\t2026/03/31\t2026/03/31\t2026/03/31\t",
    "X_Dimension\tTime\tTime\tTime\tTime\t",
    "X0\t0,0\t0,0\t0,0\t0,0\t",
    "***End_of_Header***\t\t\t\t\t",
]
MILLI = ROWS * [1e3, 1, 1, 1, 1]
SLOW = ROWS * [1e3, 1, 1, 1, 1e3]


@pytest.mark.parametrize(
    ("content", "encoding"),
    [
        pytest.param(PROTOCOL + lines(), "cp1252", id="a protocol before the header"),
        pytest.param(["Probe 7, Draht 0,15 mm, 1 N", *lines(",", point)], "utf-8", id="commas in the line before it"),
        pytest.param(["sep=;", *lines()], "utf-8", id="Excel's line for the separator"),
        pytest.param([line + ";" for line in lines()], "utf-8", id="a separator ends each row"),
        pytest.param(lines("\t"), "utf-16", id="Unicode text"),
        pytest.param(lines("\t"), "utf-16-le", id="Unicode text without its mark"),
        pytest.param(LABVIEW + lines("\t", names=["X_Value", *NAMES[1:], "Comment"]), "utf-8", id="LabVIEW"),
        pytest.param(lines(",", lambda v: f'"{comma(v)}"'), "utf-8", id="decimal commas in quotation marks"),
        pytest.param(["Zeit;Widerstand;Strom;Kraft;Weg", "s;Ohm;A;N;mm", *lines()[1:]], "utf-8", id="a row of units"),
        pytest.param(["Zeit;Widerstand;Strom;Kraft;Weg", "s;Ohm;A;N;Teile", *lines()[1:]], "utf-8", id="one unknown"),
        pytest.param([*lines()[:30], *lines()[:1], *lines()[30:]], "utf-8", id="the header again"),
        pytest.param([*lines()[:30], "", *PROTOCOL, *lines()[:1], *lines()[30:]], "utf-8", id="the protocol again"),
        pytest.param(["% wire 7", *lines()[:9], "# weight hung; 0,1 kg", *lines()[9:]], "utf-8", id="comments"),
        pytest.param(stamped(lambda t: t.isoformat(timespec="milliseconds")), "utf-8", id="ISO dates"),
        pytest.param(stamped(lambda t: f"{t:%d.%m.%Y %H:%M:%S},{t.microsecond // 10000:02}"), "utf-8", id="dates"),
        pytest.param(stamped(lambda t: f"{t:%m/%d/%Y %I:%M:%S.%f %p}"), "utf-8", id="American dates"),
        pytest.param(stamped(lambda t: f"{t:%d/%m/%Y} {t.hour}:{t:%M:%S.%f}"), "utf-8", id="British dates"),
        pytest.param(stamped(lambda t: f"{t:%Y/%m/%d %H:%M:%S.%f}"), "utf-8", id="Japanese dates"),
        pytest.param(
            stamped(lambda t: f"{t:%I:%M:%S.%f} p.m." if t.hour > 11 else f"{t:%I:%M:%S.%f} a.m."),
            "utf-8",
            id="twelve hours",
        ),
        pytest.param(stamped(lambda t: f"{t:%H:%M:%S.%f}"), "utf-8", id="clock past midnight"),
        pytest.param(lines(number=thousands, rows=SLOW), "utf-8", id="thousands"),
        pytest.param(lines("\t", lambda v: f"{v:,.4f}", rows=SLOW), "utf-8", id="English thousands"),
    ],
)
def test_the_numbers_are_read_whatever_stands_around_them(content, encoding, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes("\r\n".join(content).encode(encoding))
    table = read_table(path)
    wanted = SLOW if "1.000,0000" in "".join(content) or "1,000.0000" in "".join(content) else ROWS
    assert len(table.columns) == 5
    np.testing.assert_allclose(np.column_stack(list(table.columns.values())), wanted, atol=1e-4)


WORDS = ["NaN", "-", "Overflow", "#N/A", "OL", "9.9E37", "+9.90000000E+37", "", "#NV", "n/a"]


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize(("separator", "number"), [(";", comma), (",", point)])
def test_a_word_in_place_of_a_reading_is_a_missing_reading(word, separator, number, tmp_path):
    content = lines(separator, number)
    for i in (1, 20):  # also in the first row
        fields = content[i].split(separator)
        content[i] = separator.join([*fields[:3], word, *fields[4:]])
    (tmp_path / "log.csv").write_text("\n".join(content))
    table = read_table(tmp_path / "log.csv")
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(table.columns["Kraft [N]"])), [0, 19])


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["Temps (s)", "Tension du fil", "Courant (A)", "Force", "Déplacement (mm)"], ("wire_voltage_V", "load_N")),
        (["Time (s)", "Resistance (Ohm)", "Current (A)", "Tension", "Pos (mm)"], ("resistance_Ohm", "load_N")),
        (["Zeit", "Widerstand", "Strom", "Kraft", "Weg (mm)"], ("resistance_Ohm", "load_N")),
        (["Tiempo", "Resistencia", "Corriente", "Fuerza", "Desplazamiento [mm]"], ("resistance_Ohm", "load_N")),
        (["Tempo (s)", "Tensione (V)", "Corrente (A)", "Forza (N)", "Spostamento (mm)"], ("wire_voltage_V", "load_N")),
        (["时间(s)", "电阻(Ω)", "电流(A)", "力(N)", "位移(mm)"], ("resistance_Ohm", "load_N")),
        (["時間[s]", "抵抗[Ω]", "電流[A]", "荷重[N]", "変位[mm]"], ("resistance_Ohm", "load_N")),
    ],
)
def test_the_map_that_is_proposed_is_the_right_one_in_other_languages(names, words, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines(",", point, names)), encoding="utf-8")
    with pytest.raises(BenchLogError, match="perhaps: ") as refused:
        read_logs([path], ReadingOptions())
    proposed = dict(re.findall(r"--map '(\w+)=([^']+)'", str(refused.value)))
    ours = ["time_s", words[0], "current_A", words[1], "displacement_m"]
    assert proposed == {our: name for our, name in zip(ours, names, strict=True) if our in proposed}
    (log,) = read_logs([path], ReadingOptions(column_map([f"{a}={b}" for a, b in proposed.items()], (), (), None)))
    np.testing.assert_allclose(log[words[0]], ROWS[:, 1], atol=1e-4)
    np.testing.assert_allclose(log[words[1]], 0.98)


@pytest.mark.parametrize("name", ["contraction_mm", "Verkürzung [mm]", "Contraction (mm)"])
def test_a_column_that_counts_contraction_is_proposed_with_its_sign_beside_names_that_are_nearly_ours(name, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines(",", point, ["time", "voltage", "current", "load", name])), encoding="utf-8")
    with pytest.raises(BenchLogError, match="perhaps: --map 'time_s=time' ") as refused:
        read_logs([path], ReadingOptions())
    assert f"--map 'displacement_m={name}' --unit displacement_m=-mm" in str(refused.value)


class TestExcel:
    """Sheets, by their cells."""

    @pytest.fixture
    def book(self, tmp_path):
        openpyxl = pytest.importorskip("openpyxl")

        def write(**sheets):
            written = openpyxl.Workbook()
            written.remove(written.active)
            for title, rows in sheets.items():
                sheet = written.create_sheet(title)
                for row in rows:
                    sheet.append(list(row))
            written.save(tmp_path / "log.xlsx")
            return tmp_path / "log.xlsx"

        return write

    CELLS = (NAMES, *(list(map(float, row)) for row in ROWS))
    INFO = (["Messprotokoll"], ["Bediener", "Meier"], ["Datum", datetime.date(2026, 3, 31)], ["Last [N]", 0.98])

    @pytest.mark.parametrize(
        "sheets",
        [
            pytest.param({"Info": INFO, "Daten": CELLS}, id="text in the first sheet"),
            pytest.param({"Daten": CELLS, "Auswertung": [["Mittelwert", "Max"], [1.0, 2.0]]}, id="results in the last"),
            pytest.param({"Daten": [*INFO, [], *CELLS]}, id="a protocol before the header"),
            pytest.param({"Daten": [["t", "R", "I", "F", "s"], ["s", "Ohm", "A", "N", "mm"], *CELLS[1:]]}, id="units"),
            pytest.param({"Daten": [NAMES, *(map(comma, row) for row in ROWS)]}, id="numbers as text"),
            pytest.param(
                {
                    "Daten": [
                        NAMES,
                        *(
                            [(BEGUN + datetime.timedelta(seconds=float(row[0]))).time(), *map(float, row[1:])]
                            for row in ROWS
                        ),
                    ]
                },
                id="clock past midnight",
            ),
        ],
    )
    def test_the_numbers_are_found(self, book, sheets):
        table = read_table(book(**sheets))
        np.testing.assert_allclose(np.column_stack(list(table.columns.values())), ROWS, atol=1e-4)

    def test_a_word_in_place_of_a_reading_is_a_missing_reading(self, book):
        rows = [list(row) for row in self.CELLS]
        rows[5][3], rows[9][3], rows[11][3] = "#N/A", "-", None
        table = read_table(book(Daten=rows))
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(table.columns["Kraft [N]"])), [4, 8, 10])

    def test_of_two_logs_none_is_chosen_and_the_sentence_says_how_to_choose(self, book):
        path = book(**{"Probe 7": self.CELLS, "Probe 8": self.CELLS, "Notizen": [["Draht 7"]]})
        said = "several sheets have a log: Probe 7, Probe 8; --sheet 'Probe 7' reads that one"
        with pytest.raises(BenchLogError, match=said):
            read_table(path)

    def test_the_sheet_that_is_named_is_read(self, book):
        other = [self.CELLS[0], *([t, *rest[:-1], 7.0] for t, *rest in self.CELLS[1:])]
        path = book(A=self.CELLS, B=other, Notizen=[["Draht 7"]])
        for sheet, last in (("A", self.CELLS[-1][-1]), ("B", 7.0)):
            columns = list(read_table(path, sheet=sheet).columns.values())
            assert columns[-1][-1] == pytest.approx(last)
        with pytest.raises(BenchLogError, match="there is no sheet 'C'; its sheets are A, B, Notizen"):
            read_table(path, sheet="C")
        with pytest.raises(BenchLogError, match="the sheet 'Notizen' has no header row with numbers below it"):
            read_table(path, sheet="Notizen")

    def test_a_book_without_a_log_says_which_sheets_it_has(self, book):
        with pytest.raises(BenchLogError, match="no sheet has a header row with numbers below it; its sheets are A, B"):
            read_table(book(A=[["Draht 7"]], B=[["Bediener"]]))


CHINESE = ["时间 (s)", "电阻 (Ω)", "电流 (A)", "力 (N)", "位移 (mm)"]


@pytest.mark.parametrize("encoding", ["gb18030", "gb2312", "utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(
    "before", [[], ["试验记录：镍钛丝", "直径 0.15 mm，温度 25 ℃", ""]], ids=["alone", "a protocol"]
)
def test_chinese_names_are_read_as_they_were_written(encoding, before, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes("\r\n".join([*before, *lines(",", point, CHINESE)]).encode(encoding))
    assert list(read_table(path).columns) == CHINESE
    with pytest.raises(BenchLogError, match=re.escape("--map 'displacement_m=位移 (mm)' --unit displacement_m=mm")):
        read_logs([path], ReadingOptions())


@pytest.mark.parametrize(
    "names",
    [
        ["Zeit [s]", "größe [Ω]", "Strom [A]", "Kraft [N]", "Wärmeübergang [W/m²·K]"],
        ["tid [s]", "modstånd", "ström [A]", "kraft [µN]", "läge ±°"],
        ["t (s)", "R", "I", "F", "température éÉèÈ (°C)"],
    ],
    ids=["German", "Swedish", "French"],
)
def test_names_in_the_code_of_western_europe_stay_what_they_are(names, tmp_path):
    names = [name.replace("Ω", "Ohm") for name in names]
    path = tmp_path / "log.csv"
    path.write_bytes("\r\n".join(lines(";", point, names)).encode("cp1252"))
    assert list(read_table(path).columns) == names


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ([*PROTOCOL, *lines()[:20], "0,95;x;0,05;0,98;3,1", *lines()[21:]], "line 26, column Widerstand [Ohm]: 'x'"),
        ([*PROTOCOL, *lines()[:20], "0,95;6,0", *lines()[21:]], "line 26: 2 fields where the header has 5"),
        ([*lines()[:20], "0.9512;6.0;0.05;0.98;3.1", *lines()[21:]], "'0.9512' and '0,00000' have different decimal"),
        (["a;b;a", "1;2;3", "1;2;3"], "line 1: the column 'a' stands twice"),
    ],
)
def test_what_cannot_be_read_is_refused_in_a_sentence_with_its_line(content, said, tmp_path):
    (tmp_path / "log.csv").write_text("\n".join(content))
    with pytest.raises(BenchLogError) as refused:
        read_table(tmp_path / "log.csv")
    assert said in str(refused.value) and str(tmp_path / "log.csv") in str(refused.value)


def test_words_on_lines_of_their_own_are_left_out_and_said(tmp_path):
    content = [*lines()[:20], "*** Bediener: Pause ***", *lines()[20:], "", "Ende der Messung", "Werte: 60"]
    (tmp_path / "log.csv").write_text("\n".join(content))
    table = read_table(tmp_path / "log.csv")
    np.testing.assert_allclose(table.columns["Zeit [s]"], TIME_s)
    assert "line 21 and 2 more among the rows hold no numbers and are left out" in table.notes


def test_times_that_begin_again_are_two_logs_and_the_line_is_that_of_the_file(tmp_path):
    ours = "time_s;resistance_Ohm;current_A;load_N;displacement_m"
    rows = [";".join((comma(row[0]), "6,0", "0,05", "0,98", "0,003")) for row in ROWS]
    (tmp_path / "log.csv").write_text("\n".join([*PROTOCOL, ours, *rows, ours, *rows]))
    with pytest.raises(BenchLogError, match=r"line 67, .* .split a file that holds several recordings"):
        read_logs([tmp_path / "log.csv"], ReadingOptions())


@pytest.mark.parametrize(
    ("texts", "mark"),
    [
        (["0,5", "1.234"], ","),
        (["1.234,5"], ","),
        (["1,234,567"], "."),
        (["0,123"], ","),
        (["1,2345"], ","),
        (["1,234"], ""),
        (["17", "2"], ""),
        (["1,5E-3", "-"], ","),
    ],
)
def test_a_mark_before_three_digits_may_be_of_thousands_and_others_tell(texts, mark):
    assert decimal_mark(texts) == mark


def test_what_only_python_takes_for_a_number_is_none(tmp_path):
    """1_0 was ten, also in the middle of a column."""
    path = tmp_path / "a.csv"
    path.write_text("time_s,R\n" + "".join(f"{k},5\n" for k in range(20)) + "20,1_0\n")
    with pytest.raises(BenchLogError, match=r"line 22, column R: '1_0' is not a number"):
        read_table(path)
    path.write_text("time_s,R\n" + "".join(f"{k},1_0\n" for k in range(20)))
    assert read_table(path).left_out == {"R": "1_0"}
