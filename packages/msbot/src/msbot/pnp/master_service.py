"""Step 1: the robot's profile, published by a client of the agent like any other (R2)."""

from __future__ import annotations

import asyncio
import logging

from msbot.part import Client, ClientMaker, ConnectionState
from msbot.part.join import pnp_messages
from msbot.pnp.profile import PROFILE_PERIOD_S, PROFILE_TOPIC, PROFILE_TYPE, Profile
from msbot_xrce.errors import LinkFull, LocalProtocolError, RequestError
from msbot_xrce.objects import EndpointQos

STATUS_TIMEOUT_S = 5.0
"""How long the agent may take to create what a service needs before it is asked again."""

_log = logging.getLogger(__name__)


class MasterService:
    """Step 1: publishes the robot's profile, latched and repeated every period (thesis 3.12.1, R44).

    Args:
        make_client: makes the client that speaks for the master, called with the callbacks that it needs.
        profile: what is published.
        period_s: seconds between two publications.
        limit: number of publications after which it falls silent (the thesis' count limit); None = never.
    """

    def __init__(
        self,
        make_client: ClientMaker,
        profile: Profile,
        *,
        period_s: float = PROFILE_PERIOD_S,
        limit: int | None = None,
    ) -> None:
        self.profile = profile
        self.published = 0
        """Publications so far; also the count in the profile."""
        self._client = client = make_client(on_state=self._state_changed)
        self._period_s = period_s
        self._limit = limit
        self._opened = asyncio.Event()
        participant = client.create_participant("msbot_master")
        publisher = client.create_publisher(participant)
        topic = client.create_topic(participant, PROFILE_TOPIC, PROFILE_TYPE)
        self._writer = client.create_writer(publisher, topic, EndpointQos(transient_local=True, depth=1))

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            LinkDown: the link to the agent cannot be opened.
        """
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._client.run())
            tasks.create_task(self._publish_for_ever())

    async def _publish_for_ever(self) -> None:
        while self._limit is None or self.published < self._limit:
            await self._client.connect()
            self._opened.clear()
            if not await _is_ready(self._client):
                continue
            self._publish()
            try:
                async with asyncio.timeout(self._period_s):
                    await self._opened.wait()
            except TimeoutError:
                continue

    def _publish(self) -> None:
        self.published += 1
        try:
            self._client.write(self._writer, profile_message(self.profile, self.published).encode())
        except (LinkFull, LocalProtocolError) as error:
            _log.warning("the profile could not be published: %s", error)

    def _state_changed(self, state: ConnectionState, reason: str) -> None:
        _log.debug("master: %s: %s", state.value, reason)
        if state is ConnectionState.CONNECTED:
            self._opened.set()


def profile_message(profile: Profile, count: int) -> pnp_messages.ProfileMessage:
    """The profile as a message; the thesis defines the fields by their position (3.12.1).

    Raises:
        LocalProtocolError: a text in it is too long.
    """
    return pnp_messages.ProfileMessage(
        index=count & 0xFFFFFFFF,
        message=profile.name,
        name=profile.version,
        id=profile.serial_number,
        dof=profile.released,
        make=profile.manufacturer,
    )


async def _is_ready(client: Client) -> bool:
    try:
        await client.until_all_statuses(STATUS_TIMEOUT_S)
    except RequestError as error:
        _log.warning("the agent is not ready for the master: %s", error)
        await asyncio.sleep(1.0)
        return False
    return True
