"""A folder of EDS files: which of them describes a device.

An EDS (electronic data sheet, CiA 306) names the objects of a device, with their types, ranges and defaults.
"""

from __future__ import annotations

import configparser
import re
from pathlib import Path
from typing import Final

from canopen.objectdictionary import (
    DOMAIN,
    FLOAT_TYPES,
    INTEGER_TYPES,
    SIGNED_TYPES,
    ObjectDictionary,
    ODArray,
    ODRecord,
    ODVariable,
)
from canopen.objectdictionary.eds import import_eds

from msbot_agent.text.untrusted_input import read_input_file
from msbot_bridges.canopen.objects import Entry, SettingEntry
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MOST_FILES: Final = 500
MOST_OCTETS: Final = 4_000_000
_SETTINGS: Final = range(0x2000, 0xA000)
"""Objects of the maker and of profiles; below are those of the communication."""


@dataclass(frozen=True, slots=True)
class DataSheet:
    """What an EDS says."""

    path: Path
    vendor_name: str
    product_name: str
    dictionary: ObjectDictionary

    def variable(self, index: int, subindex: int) -> ODVariable | None:
        """One of its objects."""
        found = self.dictionary.get(index)
        if isinstance(found, ODVariable):
            return found if subindex == 0 else None
        if isinstance(found, ODRecord | ODArray):
            return found.get(subindex)
        return None

    def entries(self) -> dict[tuple[int, int], Entry]:
        """All of its whole numbers, by index and subindex."""
        return {(one.index, one.subindex): entry_of(one) for one in self._variables() if is_number(one)}

    def settings(self) -> list[SettingEntry]:
        """What can be written and is no process value."""
        found = [
            setting_of(one)
            for one in self._variables()
            if one.index in _SETTINGS and one.access_type in ("rw", "rww", "rwr") and not one.pdo_mappable
            if is_number(one) and not (one.subindex == 0 and isinstance(one.parent, ODRecord | ODArray))
        ]
        return list({setting.name: setting for setting in found}.values())

    def _variables(self) -> list[ODVariable]:
        found = list[ODVariable]()
        for one in self.dictionary.values():
            found += [one] if isinstance(one, ODVariable) else one.subindices.values()
        return [one for one in found if one.data_type != DOMAIN]


class EdsFolder:
    """The files of a folder, by vendor and product.

    Args:
        folder: where `*.eds` are; None: nowhere.

    Raises:
        ConfigError: there is no such folder, or one of its files cannot be read.
    """

    def __init__(self, folder: Path | None) -> None:
        self._by_product: dict[tuple[int, int], Path] = {}
        if folder is None:
            return
        if not folder.is_dir():
            raise ConfigError(f"--option eds={folder}: there is no such folder")
        paths = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".eds")
        if len(paths) > MOST_FILES:
            raise ConfigError(f"{folder} has {len(paths)} EDS files, and may have {MOST_FILES}")
        for path in paths:
            product = _product(path)
            if other := self._by_product.get(product):
                raise ConfigError(f"{path} and {other.name} describe the same product; remove one of them")
            self._by_product[product] = path
            self._read(path, 1)  # its mistakes are told now, and not when a device is plugged in

    def find(self, vendor: int, product: int, node_id: int) -> DataSheet | None:
        """The one for a device; None: there is none."""
        path = self._by_product.get((vendor, product))
        return None if path is None else self._read(path, node_id)

    @staticmethod
    def _read(path: Path, node_id: int) -> DataSheet:
        try:
            dictionary = import_eds(str(path), node_id)
        except Exception as error:  # the library raises whatever comes of a wrong value
            raise ConfigError(f"{path}: {type(error).__name__}: {error}") from error
        about = dictionary.device_information
        return DataSheet(path, about.vendor_name or "", about.product_name or "", dictionary)


def _product(path: Path) -> tuple[int, int]:
    parser = configparser.RawConfigParser(inline_comment_prefixes=(";",), strict=False)
    try:
        parser.read_string(read_input_file(path, MOST_OCTETS, "an EDS").decode("utf-8", "replace"))
        about = parser["DeviceInfo"]
        return int(about["VendorNumber"], 0), int(about["ProductNumber"], 0)
    except (configparser.Error, KeyError, ValueError) as error:
        raise ConfigError(
            f"{path}: [DeviceInfo] needs VendorNumber and ProductNumber, as the device has them in 0x1018 ({error})"
        ) from error


def is_number(one: ODVariable) -> bool:
    """Whether it is a whole number or a truth value of up to 64 bits."""
    return one.data_type in INTEGER_TYPES or (one.data_type == 1 and one.data_type not in FLOAT_TYPES)


def entry_of(one: ODVariable) -> Entry:
    """Where it is, and its bits."""
    return Entry(one.index, one.subindex, len(one) if one.data_type != 1 else 8, one.data_type in SIGNED_TYPES)


def setting_of(one: ODVariable) -> SettingEntry:
    """An object of an EDS as a setting, in its physical unit where the EDS has a factor."""
    entry, factor = entry_of(one), float(one.factor or 1)
    name = one.name
    if isinstance(one.parent, ODRecord | ODArray):
        name = f"{one.parent.name} {one.name}"
    least, most = (None if limit is None else limit * factor for limit in (one.min, one.max))
    return SettingEntry(
        slug(name),
        entry,
        int if factor == 1 else float,
        factor,
        least,
        most,
        None if not isinstance(one.default, int | float) else one.default * factor,
        one.unit or "",
    )


def slug(name: str) -> str:
    """A name for a setting or port: `Profile velocity` becomes `profile_velocity`."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:40] or "object"
