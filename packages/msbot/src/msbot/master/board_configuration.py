"""What the master adds to the configuration of a board: a document for each part that is wired to it."""

from __future__ import annotations

from dataclasses import replace

from msbot.config import Library, WiredPart, board_documents, wired_parts
from msbot.pnp import Configuration
from msbot_xrce.errors import ConfigError


def with_documents(
    configuration: Configuration, number: str, library: Library | None
) -> tuple[Configuration, list[str]]:
    """The configuration with the documents in place of the texts that people write, and what is wrong with these.

    A text that makes no sense is left out; the others hold.

    Args:
        configuration: of a slot.
        number: the part number that the slot expects.
        library: the part types; None: no slot is that of a board.
    """
    part_type = None if library is None else library.find(number)
    if library is None or part_type is None or not part_type.carries:
        return configuration, []
    texts = {name: text for name, text in configuration.settings if name in part_type.carries}
    good: dict[str, str] = {}
    faults: list[str] = []
    for name, text in sorted(texts.items()):
        try:
            board_documents(wired_parts({**good, name: text}, library))
        except ConfigError as error:
            faults.append(str(error))
        else:
            good[name] = text
    parts: dict[str, WiredPart] = wired_parts(good, library)
    rest = tuple(pair for pair in configuration.settings if pair[0] not in texts)
    return replace(configuration, settings=(*rest, *board_documents(parts).items())), faults
