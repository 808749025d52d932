"""Clock and disk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msbot.doctor.facts import ClockFacts, WrittenFolder
from msbot.doctor.finding import Finding, Unavailable
from msbot_agent.text.sentence import said

SKEW_S = 120.0
LOW_MB = 200.0
LOW_SHARE = 0.03
STAMPS = said("time stamps of ROS messages and of captures are wrong; MsBOT's own messages have none")


def check_clock(facts: ClockFacts) -> Iterator[Finding | Unavailable]:
    """Whether the clock can be right."""
    set_it = "sudo timedatectl set-ntp true"
    if facts.now_s < facts.built_s - SKEW_S:
        yield Finding(
            "clock-past",
            "clock",
            said("the clock says a time before this MsBOT was installed"),
            said(
                "journal, recordings and certificates are dated wrongly; a computer without a battery begins anew at "
                "each start"
            ),
            STAMPS,
            set_it,
        )
    elif facts.newest_record_s is not None and facts.newest_record_s > facts.now_s + SKEW_S:
        yield Finding(
            "clock-jumped",
            "clock",
            said(
                "the journal has lines that are {minutes:.0f} minutes in the future: the clock was set back",
                minutes=(facts.newest_record_s - facts.now_s) / 60,
            ),
            said("what happened when cannot be told from the journal"),
            STAMPS,
            set_it,
        )
    if isinstance(facts.is_synchronised, Unavailable):
        yield facts.is_synchronised
    elif not facts.is_synchronised:
        yield Finding(
            "clock-free",
            "clock",
            said("no time server sets the clock"),
            said("computers of one robot drift apart: their recordings and journals cannot be compared"),
            STAMPS,
            set_it,
            must=False,
        )


def check_disk(places: Sequence[WrittenFolder]) -> Iterator[Finding]:
    """Whether what is to be kept can be written."""
    for place in places:
        wire = said("nothing: the robot goes on, and what happens is not kept")
        if place.read_only:
            yield Finding(
                "disk-read-only",
                place.path,
                said("the disk of {path} is read-only", path=place.path),
                said("nothing can be kept; Linux does this when a card is failing: make a copy of it now"),
                wire,
                f"sudo mount -o remount,rw $(findmnt -no TARGET -T {place.path})",
            )
        elif not place.is_writable:
            yield Finding(
                "not-writable",
                place.path,
                said("you may not write to {path}", path=place.path),
                said("the {what} of the robot cannot be kept there", what=said(place.what)),
                wire,
                f"sudo chown -R $USER {place.path}",
            )
        low = place.free_mb < LOW_MB and place.free_mb < place.size_mb / 2
        if low or (place.free_mb < LOW_SHARE * place.size_mb and place.free_mb < 5 * LOW_MB):
            yield Finding(
                "disk-full",
                place.path,
                said("the disk of {path} has {free:.0f} MB left", path=place.path, free=place.free_mb),
                said("changes and recordings are lost when it is full"),
                wire,
                f"du -xh {place.path} | sort -h | tail",
                first=said("delete or move what is not needed"),
            )
        elif place.free_files < LOW_SHARE:
            yield Finding(
                "disk-files",
                place.path,
                said("the disk of {path} has room for hardly any more files", path=place.path),
                said("no file can be made, although there is space"),
                wire,
                f"df -i {place.path}",
                first=said("delete or move what is not needed"),
            )
