"""Emergency messages (EMCY) in words: codes of CiA 301, and of drives as CiA 402 names them. Pure."""

from __future__ import annotations

from typing import Final

_REGISTER: Final = (
    "generic",
    "current",
    "voltage",
    "temperature",
    "communication",
    "device profile",
    "reserved",
    "manufacturer",
)

_CODES: Final = {
    0x1000: "generic error",
    0x2000: "current",
    0x2100: "current on the input side",
    0x2110: "short circuit or earth leakage at the input",
    0x2200: "current inside the device",
    0x2300: "current on the output side",
    0x2310: "continuous over-current",
    0x2320: "short circuit or earth leakage at the output",
    0x2330: "earth leakage",
    0x2340: "short circuit of motor phases",
    0x2350: "load too high for too long (I²t)",
    0x3000: "voltage",
    0x3100: "mains voltage",
    0x3110: "mains over-voltage",
    0x3120: "mains under-voltage",
    0x3200: "voltage inside the device",
    0x3210: "over-voltage of the DC link",
    0x3220: "under-voltage of the DC link",
    0x3300: "output voltage",
    0x4000: "temperature",
    0x4100: "temperature of the surroundings",
    0x4200: "temperature of the device",
    0x4210: "the device is too warm",
    0x4220: "the device is too cold",
    0x4300: "temperature of the drive",
    0x4310: "the drive is too warm",
    0x5000: "hardware of the device",
    0x5100: "supply of the device",
    0x5200: "control unit",
    0x5300: "operating unit",
    0x5400: "power section",
    0x5500: "data memory",
    0x6000: "software of the device",
    0x6100: "internal software",
    0x6200: "user's software",
    0x6300: "data record",
    0x6320: "parameter error",
    0x7000: "additional modules",
    0x7100: "power module",
    0x7120: "motor",
    0x7121: "the motor is blocked",
    0x7200: "measuring circuit",
    0x7300: "sensor",
    0x7305: "encoder",
    0x7500: "communication of additional modules",
    0x8000: "monitoring",
    0x8100: "communication",
    0x8110: "CAN frames were lost",
    0x8120: "CAN is error-passive",
    0x8130: "heartbeat or life guarding of the master is missing",
    0x8140: "it has recovered from bus-off",
    0x8150: "two nodes send the same identifier",
    0x8200: "protocol error",
    0x8210: "a PDO is too short and was not processed",
    0x8220: "a PDO is too long",
    0x8300: "torque control",
    0x8400: "speed control",
    0x8500: "position control",
    0x8611: "following error: the drive cannot follow its target",
    0x8612: "a limit of the position was reached",
    0x9000: "external error",
    0xF000: "additional functions",
    0xFF00: "error of the maker's own",
}


def emergency_words(code: int, register: int) -> str:
    """What an emergency message says, as the rest of a sentence."""
    known = next((_CODES[masked] for mask in (0xFFFF, 0xFFF0, 0xFF00, 0xF000) if (masked := code & mask) in _CODES), "")
    words = f"emergency 0x{code:04X}" + (f": {known}" if known else "")
    kinds = ", ".join(kind for bit, kind in enumerate(_REGISTER) if register >> bit & 1)
    return f"{words} (error register: {kinds})" if kinds else words


def is_reset(code: int) -> bool:
    """Whether the message says that an error is gone."""
    return code & 0xFF00 == 0
