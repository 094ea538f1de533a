"""Tables in plain text."""

from pinadapt._output import Sheet, Table, columns, number


def test_numbers_are_right_aligned_and_words_left_aligned():
    rows = [["a [x]", "1.0", "ok"], ["bb", "10.25", "diverged: no\tmore"]]
    header, rule, *lines = columns(("run", "error [mm]", "verdict"), rows).splitlines()
    assert set(rule) == {"-"} and len(rule) >= len(header)
    end = header.index("error [mm]") + len("error [mm]")
    for line, row in zip(lines, rows, strict=True):
        assert line.startswith(row[0]) and line[:end].endswith(row[1])
        assert line[header.index("verdict") :].split() == row[2].split()
        assert line == line.rstrip()


def test_two_columns_under_a_title():
    sheet = Sheet("a long title", [Table([("law", "1.0"), ("error, last", "0.50")])])
    assert str(sheet).splitlines() == [
        "a long title",
        "------------",
        "law           1.0",
        "error, last   0.50",
    ]


def test_numbers_have_units_and_none_is_a_dash():
    assert number(0.0012345, "mm", scale=1e3) == "1.234 mm"
    assert number(None, "mm") == "-" and number(2.0, digits=0) == "2"
