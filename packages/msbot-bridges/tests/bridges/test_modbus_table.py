"""Tables of registers: what they mean, how numbers are written, and what is said about each mistake."""

from __future__ import annotations

from pathlib import Path

import pytest

from msbot.part.messages.standard import Distance, Speed, Switch, Temperature
from msbot_bridges.bridge import BridgeLink
from msbot_bridges.modbus.address import LineAddress, read_address
from msbot_bridges.modbus.device_table import DeviceTable, read_device_table
from msbot_bridges.modbus.points import ModbusPoint, PointUse, RegisterTable, blocks
from msbot_bridges.modbus.world import tables_of
from msbot_xrce.errors import ConfigError

PUMP = Path(__file__).parents[4] / "examples" / "makers" / "pump.toml"
HEAD = 'maker = "A"\nproduct = "b"\n'


def table(folder: Path, text: str) -> DeviceTable:
    file = folder / "device.toml"
    file.write_text(HEAD + text)
    return read_device_table(file)


def point(
    format: str = "uint16",
    words: str = "big",
    *,
    scale: float = 1.0,
    least: float | None = None,
    most: float | None = None,
) -> ModbusPoint:
    return ModbusPoint(
        "x", PointUse.IN, RegisterTable.HOLDING, 0, format, words, scale=scale, least=least, most=most, safe=0.0
    )


def test_the_example_is_read() -> None:
    pump = read_device_table(PUMP)
    assert [(one.name, one.role.value, one.message) for one in pump.points] == [
        ("speed", "in", Speed),
        ("turns", "out", Speed),
        ("temperature", "out", Temperature),
        ("valve", "in", Switch),
        ("dry", "out", Switch),
        ("ramp", "setting", pump.points[-1].message),
    ]
    assert pump.units == (1,)


@pytest.mark.parametrize(
    ("one", "value", "words"),
    [
        (point(), 513, [513]),
        (point("int16"), -2, [0xFFFE]),
        (point("int16", scale=0.1), -2.5, [0xFFE7]),
        (point("uint32"), 65_537, [1, 1]),
        (point("uint32", "little"), 131_073, [1, 2]),
        (point("float32"), 1.5, [0x3FC0, 0]),
        (point("float32", "little"), 1.5, [0, 0x3FC0]),
        (point("float64"), 1.0, [0x3FF0, 0, 0, 0]),
        (point(most=10.0), 99, [10]),
        (point(least=5.0), 0, [5]),
    ],
)
def test_a_number_is_written_as_the_table_says_and_read_back(one: ModbusPoint, value: float, words: list[int]) -> None:
    assert one.write(value) == words
    assert one.is_at(one.read(words), value)


@pytest.mark.parametrize(("one", "value"), [(point(), -1), (point(), 70_000), (point(), float("nan"))])
def test_what_does_not_fit_is_refused(one: ModbusPoint, value: float) -> None:
    with pytest.raises(ConfigError):
        one.write(value)


def test_a_distance_in_millimetres_is_in_metres() -> None:
    one = ModbusPoint("d", PointUse.OUT, RegisterTable.INPUT, 0, unit="mm")
    assert one.message_of(one.read([420])) == Distance(metres=0.42, in_range=True)


def test_neighbours_are_read_together_and_gaps_never() -> None:
    points = [
        ModbusPoint("a", PointUse.OUT, RegisterTable.HOLDING, 10),
        ModbusPoint("b", PointUse.OUT, RegisterTable.HOLDING, 11, "float32"),
        ModbusPoint("c", PointUse.OUT, RegisterTable.HOLDING, 14),
        ModbusPoint("d", PointUse.OUT, RegisterTable.COIL, 0),
    ]
    assert [(one.table.value, one.address, one.count) for one in blocks(points)] == [
        ("coil", 0, 1),
        ("holding", 10, 3),
        ("holding", 14, 1),
    ]
    many = [ModbusPoint(str(at), PointUse.OUT, RegisterTable.INPUT, at) for at in range(250)]
    assert [one.count for one in blocks(many)] == [100, 100, 50]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no point"),
        ('[[point]]\nport = "a"\n', "add, for example, address = 16"),
        ('[[point]]\nport = "a"\naddress = 70000\n', "must be 0 to 65535"),
        ('[[point]]\nport = "a"\naddress = 1\ntable = "register"\n', 'none of "coil"'),
        ('[[point]]\nport = "a"\naddress = 1\ntype = "word"\n', 'none of "uint16"'),
        ('[[point]]\nport = "a"\naddress = 1\nrole = "in"\ntable = "input"\n', 'nobody can write a "input"'),
        ('[[point]]\nport = "a"\naddress = 1\nsafe = 1\n', 'only for points with another role than "out"'),
        ('[[point]]\nport = "a"\naddress = 1\nrole = "in"\nmost = 5\nsafe = 9\n', "the range is"),
        ('[[point]]\nport = "a"\naddress = 1\nrole = "in"\nsafe = -1\n', "does not fit into its 1 registers"),
        ('[[point]]\nport = "a"\naddress = 1\nrole = "in"\nconfirmed_by = "b"\n', 'is no point with role "out"'),
        ('[[point]]\nport = "a"\naddress = 1\nleast = 5\nmost = 5\n', "must be less than most"),
        ('[[point]]\nport = "a"\naddress = 1\nscale = 0\n', "every value would be the same"),
        ('[[point]]\nport = "a"\naddress = 1\n[[point]]\nport = "a"\naddress = 2\n', "another point with the name"),
        ('[[point]]\nport = "a"\naddress = 65535\ntype = "uint32"\n', "not all of its registers are there"),
        ('[[point]]\nport = "a"\naddress = 1\nadress = 2\n', "adress"),
    ],
)
def test_each_mistake_is_said_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        table(tmp_path, text)
    assert words in str(caught.value)
    assert "device.toml" in str(caught.value)


def test_a_unit_is_named_once(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.toml").write_text(HEAD + 'units = [1, 2]\n[[point]]\nport = "a"\naddress = 1\n')
    with pytest.raises(ConfigError, match="unit 1 is in two places"):
        tables_of(BridgeLink("tcp:x", {"table": f"{tmp_path}/a.toml,{tmp_path}/b.toml"}))
    with pytest.raises(ConfigError, match="say what the registers are"):
        tables_of(BridgeLink("tcp:x", {}))


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("tcp:pump", LineAddress("tcp:pump", "pump")),
        ("tcp:[::1]:1502", LineAddress("tcp:[::1]:1502", "::1", 1502)),
        ("rtu+tcp:gate:4001", LineAddress("rtu+tcp:gate:4001", "gate", 4001, True)),
        ("rtu:/dev/ttyS0?baud=9600&parity=N&stop=2", None),
    ],
)
def test_addresses(text: str, address: LineAddress | None) -> None:
    expected = address or LineAddress(text, "/dev/ttyS0", 0, True, True, 9600, "N", 2)
    assert read_address(text) == expected


@pytest.mark.parametrize("text", ["pump", "tcp:", "tcp:x:0", "tcp:x:y", "rtu:", "rtu:/dev/x?speed=1", "udp:x"])
def test_what_is_no_address_is_refused_with_the_right_form(text: str) -> None:
    with pytest.raises(ConfigError, match="write tcp:HOST"):
        read_address(text)


@pytest.mark.parametrize("text", ["rtu:/dev/x?baud=12", "rtu:/dev/x?parity=X", "rtu:/dev/x?stop=3"])
def test_a_serial_line_has_the_settings_of_one(text: str) -> None:
    with pytest.raises(ConfigError, match=r"baud is one of|parity is E"):
        read_address(text)
