"""A part at the master of the thesis' own programs says that it does not join; one of MsBOT is not disturbed."""

from __future__ import annotations

import asyncio
from functools import partial

import pytest

from msbot.part.client.client import Client
from msbot.part.join import pnp_messages, thesis_messages
from msbot.part.join.joining import UNANSWERED_S, AskThesisMaster, Changed, ExpectedRobot, Joining, JoinState, SendClaim
from msbot.part.join.membership import THESIS_INVENTORY, Membership
from msbot.pnp.thesis_claims import decode_thesis_claim
from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent
from msbot_agent.link.in_process import inproc_pair
from msbot_agent.space import MemorySpace
from tests.hearing_client import HearingClient

CLAIM = pnp_messages.ClaimMessage(part_number="EFGH", local_name="EFGH-local", uid=bytes(8), session_nonce=1)
PROFILE = pnp_messages.ProfileMessage(
    index=1, message="MSBOT_MASTER", name="MSBOT_V1", id="X100Y100Z100", dof="8-4-2021", make="MASSEY_ENGINEERING_DEP"
)


def test_nobody_is_asked_before_claims_have_gone_unanswered_for_a_while_and_then_once() -> None:
    joining = Joining(ExpectedRobot())
    joining.session_opened(0.0)
    joining.profile_seen(ExpectedRobot("MSBOT_MASTER"), 1.0)
    asked_at = []
    while (due := joining.timer()) is not None and due < 60.0:
        joining.handle_timer(due)
        while (action := joining.next_action()) is not None:
            assert isinstance(action, SendClaim | AskThesisMaster | Changed)
            if isinstance(action, AskThesisMaster):
                asked_at.append(due)
    assert asked_at == [1.0 + UNANSWERED_S]


def test_an_inventory_of_msbot_knows_the_question_from_a_claim() -> None:
    question = thesis_messages.probe_request("EFGH", "EFGH-local")
    assert question is not None
    assert decode_thesis_claim(question).part_number == "EFGH", "a request of the thesis"
    assert thesis_messages.is_probe_request(question)
    assert not thesis_messages.is_probe_request(thesis_messages.encode_request("EFGH", "EFGH-local"))
    assert thesis_messages.probe_request("x" * 60, "y" * 40) is None, "it does not fit: nothing is asked"


@pytest.mark.promise("A part says what it has found, whoever's master it is")
def test_a_part_at_the_thesis_own_master_says_that_it_does_not_join() -> None:
    changes: list[Changed] = []
    requests: list[bytes] = []

    async def main() -> None:
        agent = Agent(MemorySpace())
        for_master, masters = inproc_pair()
        for_part, parts = inproc_pair()
        agent.add_link(for_master)
        agent.add_link(for_part)
        master = HearingClient(masters, key=0xEFEFEFEF)
        membership = Membership(
            partial(Client, parts, key=1),
            Joining(ExpectedRobot()),
            CLAIM,
            changed=changes.append,
            configure=lambda _: None,
        )
        tasks = [asyncio.create_task(one.run()) for one in (agent, master)]
        await master.connect(60.0)
        participant = master.create_participant()
        inventory = master.create_replier(participant, THESIS_INVENTORY)
        topic = master.create_topic(participant, pnp_messages.PROFILE_TOPIC, pnp_messages.PROFILE_TYPE)
        profile = master.create_writer(master.create_publisher(participant), topic)

        def answer(_object_id: int, _request_id: int, identity: bytes, payload: bytes) -> None:
            requests.append(payload)
            number, _ = thesis_messages.read_string(payload, 0)
            master.reply(inventory, identity, thesis_messages.encode_reply(number))  # whoever it is

        master.on_request = answer
        master.read(inventory)
        membership.start()
        tasks.append(asyncio.create_task(membership.client.run()))
        for _ in range(6):
            await asyncio.sleep(5)
            master.write(profile, PROFILE.encode())
        last = changes[-1]
        assert (last.after, last.reason) == (JoinState.CLAIMING, thesis_messages.DOES_NOT_JOIN)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    run_virtual(main())
    assert [thesis_messages.is_probe_request(one) for one in requests] == [True], "once, and no claim"
