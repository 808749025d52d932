"""Which part a person means by a word."""

from __future__ import annotations

import string
from collections.abc import Callable, Iterable, Sequence

from msbot.pnp import PartInfo, PartState
from msbot.registry import PartRecord
from msbot_agent.text.sentence import joined, said
from msbot_agent.text.similar_names import did_you_mean, instead_of, nearest
from msbot_xrce.errors import ConfigError, NotThere

UID_DIGITS = 16


def one_part(
    word: str, found: Sequence[PartInfo], all_parts: Sequence[PartInfo], prefer: Callable[[PartInfo], bool]
) -> PartInfo:
    """The part that a person means, out of those that are present.

    Args:
        word: what the person wrote.
        found: the parts known by that word.
        all_parts: all parts.
        prefer: decides when several are present.

    Raises:
        ConfigError: there is no such part, or there are several.
    """
    here = [info for info in found if not info.state.is_over]
    wanted = [info for info in here if prefer(info)] or here
    if len({info.uid for info in wanted}) == 1:  # whoever shows a part's UID and is refused is not that part
        wanted = [info for info in wanted if info.state is not PartState.REFUSED] or wanted
    if len(wanted) == 1:
        return wanted[0]
    if wanted:
        names = joined("; ", (describe(info) for info in wanted))
        raise ConfigError(
            said(
                "{count} parts are known as {word!r}: name one by its UID or address: {names}",
                count=len(wanted),
                word=word,
                names=names,
            )
        )
    if found:
        gone = found[-1]
        raise ConfigError(
            said(
                "{gone} is not plugged in: {state}, {reason}",
                gone=gone.part,
                state=said(gone.state.value),
                reason=gone.reason,
            )
        )
    here = [info for info in all_parts if not info.state.is_over]
    known = {info.part: info.part != info.address for info in here}
    shown = (name if is_name else said("{address}", address=name) for name, is_name in known.items())
    names = joined(", ", shown)
    words = {info.slot for info in here if info.slot} | {info.part_number for info in here if info.part_number}
    near = nearest(word, [*(name for name, is_name in known.items() if is_name), *sorted(words - known.keys())])
    hint = did_you_mean(near) if near else said("there are {known}", known=names or said("none yet"))
    raise NotThere(said("no part is known as {word!r}; {hint}", word=word, hint=hint))


def known_part(word: str, records: Sequence[PartRecord]) -> PartRecord:
    """The one part that a person means, out of those that the database knows.

    Raises:
        ConfigError: none, or several.
    """
    uid = uid_of(word)
    wanted = word.casefold()
    found = [
        one
        for one in records
        if (one.uid and one.uid == uid) or wanted in (one.name.casefold(), one.part_number.casefold())
    ]
    if len(found) == 1:
        return found[0]
    if found:
        names = "; ".join(
            said("{name} ({part_number}, UID {one})", name=one.name, part_number=one.part_number, one=one.uid.hex())
            for one in found
        )
        raise ConfigError(
            said(
                "{count} parts are known as {word!r}: name one by its UID: {names}",
                count=len(found),
                word=word,
                names=names,
            )
        )
    known_words = dict.fromkeys([*(one.name for one in records), *(one.part_number for one in records)])
    if near := nearest(word, known_words):
        raise ConfigError(said("no part is known as {word!r}; {hint}", word=word, hint=did_you_mean(near)))
    raise ConfigError(
        said(
            "no part is known as {word!r}; seen so far: {records}",
            word=word,
            records=", ".join(one.name for one in records) or said("none"),
        )
    )


def one_slot(name: str, names: Iterable[str]) -> str:
    """The slot of that name; capitals do not matter when it is clear.

    Raises:
        NotThere: there is none.
    """
    known = list(names)
    if name in known:
        return name
    alike = [one for one in known if one.casefold() == name.casefold()]
    if len(alike) == 1:
        return alike[0]
    raise NotThere(said("the robot has no slot {name!r}; {hint}", name=name, hint=instead_of(name, known)))


def describe(info: PartInfo) -> str:
    """A part in a few words that distinguish it from others."""
    uid = said("UID {uid}", uid=info.uid.hex()) if info.uid else said("no UID")
    where = said("in slot {slot}", slot=info.slot) if info.slot else said(info.state.value)
    return said(
        "{part} ({number}, {uid}, {where}, at {address})",
        part=info.part,
        number=info.part_number or said("not claimed yet"),
        uid=uid,
        where=where,
        address=info.address,
    )


def uid_of(word: str) -> bytes | None:
    """The UID that a person typed, or None when it is something else."""
    digits = word.replace(":", "").replace("-", "")
    if len(digits) == UID_DIGITS and all(digit in string.hexdigits for digit in digits):
        return bytes.fromhex(digits)
    return None
