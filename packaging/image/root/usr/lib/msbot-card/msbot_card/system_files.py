"""What Linux reads of the card's settings. Pure."""

from __future__ import annotations

from msbot_card.settings import Settings

MASTER = "--host 0.0.0.0 --port 80 --link udp:0.0.0.0:8888"
"""Options of the robot's master on the card."""


def wifi(settings: Settings) -> str:
    """The file of wpa_supplicant: names and keys as hexadecimal digits, which cannot be mistaken for anything else."""
    proof = f"psk={settings.key}\n\tkey_mgmt=WPA-PSK WPA-PSK-SHA256" if settings.key else "key_mgmt=NONE"
    return (
        f"country={settings.country}\nupdate_config=0\nnetwork={{\n"
        f"\tssid={settings.network.encode().hex()}\n\tscan_ssid=1\n\t{proof}\n}}\n"
    )


def can(settings: Settings) -> str:
    """`/etc/msbot/can.env`: with what CAN interfaces come up."""
    asked = "" if settings.can == "none" else f"bitrate {settings.can_bitrate} restart-ms 100"
    return f'MSBOT_CAN="{asked}"\n'


def master(settings: Settings, *, bus_is_up: bool, is_open: bool) -> str:
    """`/etc/msbot/master.env`: a CAN bus that is up is one of the ways to the robot; the master refuses one that is
    not, and its page would be gone with it.

    Args:
        settings: what is set.
        bus_is_up: whether the CAN bus is.
        is_open: whether the first visitor becomes the administrator.
    """
    bus = " --link can:can0" if settings.can != "none" and bus_is_up else ""
    return f'MSBOT_MASTER="{MASTER}{bus}{" --open-set-up" if is_open else ""}"\n'


def hosts(settings: Settings) -> str:
    """`/etc/hosts`."""
    return f"127.0.0.1 localhost\n127.0.1.1 {settings.name}\n::1 localhost\n"


def issue(settings: Settings) -> str:
    """What a screen shows, for whom has one."""
    return f"\nMsBOT. The robot's page: http://{settings.name}.local  or  http://\\4\n\n"
