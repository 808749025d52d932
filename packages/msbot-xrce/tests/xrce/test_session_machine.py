"""A state machine: whatever the network does, reliable samples arrive exactly once and in order once it heals."""

from __future__ import annotations

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from msbot_xrce import ClientState
from msbot_xrce.sessions import DataReceived, DataWritten
from tests.effort import tries
from tests.xrce.pair import Pair

WRITER, READER = 0x15, 0x16
RESET = bytes.fromhex("810000000c010000")

sizes = st.sampled_from([0, 1, 4, 30, 60, 200, 1000])


class SessionMachine(RuleBasedStateMachine):
    """Samples carry a number; what was under way at a login or RESET may be lost, but never comes late or twice."""

    def __init__(self) -> None:
        super().__init__()
        self.pair = Pair(mtu=68)
        self.number = 0
        self.to_agent: list[bytes] = []
        self.to_client: list[bytes] = []

    def sample(self, size: int) -> bytes:
        self.number += 1
        return self.number.to_bytes(4, "big") + bytes(size)

    @rule(size=sizes, count=st.integers(1, 20))
    def client_writes(self, size: int, count: int) -> None:
        for _ in range(count):
            if self.pair.client.has_room(0x80):
                payload = self.sample(size)
                self.pair.client.write(WRITER, payload, 0x80)
                self.to_agent.append(payload)

    @rule(size=sizes, count=st.integers(1, 20))
    def agent_sends(self, size: int, count: int) -> None:
        for _ in range(count):
            payload = self.sample(size)
            if self.pair.agent.send_data(0x1D, READER, payload, 0x80):
                self.to_client.append(payload)

    @rule(count=st.integers(1, 3))
    def best_effort_samples_pass_by(self, count: int) -> None:
        for _ in range(count):
            self.pair.client.write(0x25, b"best effort", 1)
            self.pair.agent.send_data(0x2D, 0x26, b"best effort", 1)

    @rule(
        loss=st.sampled_from([0.0, 0.05, 0.3, 1.0]),
        duplicate=st.sampled_from([0.0, 0.3]),
        reorder=st.sampled_from([0.0, 0.3]),
    )
    def network_changes(self, loss: float, duplicate: float, reorder: float) -> None:
        self.pair.loss, self.pair.duplicate, self.pair.reorder = loss, duplicate, reorder

    @rule(seconds=st.sampled_from([0.0005, 0.004, 0.05, 0.3]))
    def time_passes(self, seconds: float) -> None:
        self.pair.run(seconds)

    @rule()
    def client_logs_in_again(self) -> None:
        self.begin_anew()
        self.pair.client.connect(self.pair.now)
        self.pair.run(0.01)

    @rule()
    def client_resets(self) -> None:
        """RESET is not acknowledged, so a client sends it only when it begins anew itself."""
        self.begin_anew()
        self.pair.agent.receive_packet(RESET, self.pair.now)
        while self.pair.agent.next_event() is not None:
            pass
        self.pair.client.connect(self.pair.now)
        self.pair.run(0.01)

    @rule()
    def network_heals(self) -> None:
        self.settle()
        assert self.arrived_at_agent() == self.to_agent
        assert self.arrived_at_client() == self.to_client

    @invariant()
    def what_has_arrived_is_a_beginning_of_what_was_sent(self) -> None:
        arrived = self.arrived_at_agent()
        assert arrived == self.to_agent[: len(arrived)]
        arrived = self.arrived_at_client()
        assert arrived == self.to_client[: len(arrived)]

    @invariant()
    def at_rest_there_is_nothing_to_send_and_nothing_to_wait_for(self) -> None:
        agent = self.pair.agent
        if agent.is_at_rest():
            assert agent.timer() is None
            assert agent.packets_to_send(self.pair.now) == []
            assert agent.is_at_rest()

    def teardown(self) -> None:
        self.network_heals()

    def settle(self) -> None:
        self.pair.heal()
        self.pair.settle()
        assert self.pair.client.state is ClientState.CONNECTED
        assert self.pair.client.has_room(0x80)
        assert self.pair.agent.has_room(0x80)

    def begin_anew(self) -> None:
        """The cable is unplugged and plugged in again: nothing old comes, and the handshake itself is not disturbed."""
        self.what_has_arrived_is_a_beginning_of_what_was_sent()
        self.pair.cut()
        self.pair.heal()
        self.pair.take_agent_events()
        self.pair.take_client_events()
        self.to_agent.clear()
        self.to_client.clear()

    def arrived_at_agent(self) -> list[bytes]:
        events = self.pair.agent_events
        return [event.payload for event in events if isinstance(event, DataWritten) and event.object_id == WRITER]

    def arrived_at_client(self) -> list[bytes]:
        events = self.pair.client_events
        return [event.payload for event in events if isinstance(event, DataReceived) and event.object_id == READER]


SessionMachine.TestCase.settings = settings(
    deadline=None, max_examples=tries(60, 2000), stateful_step_count=40, suppress_health_check=[HealthCheck.too_slow]
)
TestSessions = SessionMachine.TestCase
