"""A participant in one DDS domain, with its topics."""

from __future__ import annotations

import ctypes
import os
from ctypes import byref

from msbot_agent.space.dds.dds_network import Network, check_domain
from msbot_agent.space.dds.libddsc import PRECONDITION_NOT_MET, DdsLibrary
from msbot_agent.space.dds.native_qos import private_qos
from msbot_agent.space.dds.raw_type import Serialiser, descriptor, type_by_sample, type_of
from msbot_agent.space.dds.ros_type_hashes import user_data_of
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

_SELF_TEST = "msbot_self_test"
_ENCLAVE = b"enclave=/;"
"""What ROS 2 nodes look for in a participant before they believe that nodes live in it (rmw_dds_common)."""
LONGEST_NAME = 1024
"""Octets of the name of a topic or type: the library ends the process with those of 64 kB."""
_BODIES = (b"", b"MsBOT", bytes(range(256)) * 5)


@dataclass(slots=True)
class NativeTopic:
    """A topic in the library."""

    entity: int
    sample_type: int
    """The library's type that samples of this topic are made with."""
    users: int = 0


class Domain:
    """This process' participant in a domain; made when it is first needed."""

    def __init__(self, library: DdsLibrary, network: Network, number: int) -> None:
        """Join the domain, and check that the library passes octets through unchanged.

        Raises:
            ConfigError: there is no such domain, its ports are taken, or the library does not work as it should.
        """
        check_domain(number)
        self.number = number
        self._library = library
        self._calls = library.calls
        self._own_domain: int | None = None
        self._topics: dict[tuple[str, str], NativeTopic] = {}
        self._generic_type: int | None = None
        self._generic_topic: int | None = None
        if network.config is not None:
            code = self._calls.dds_create_domain(number, network.config.encode())
            if code >= 0:
                self._own_domain = code
            elif code != PRECONDITION_NOT_MET:  # otherwise this process has joined it already
                raise self._no_participant(code)
        qos = self._calls.dds_create_qos()
        self._calls.dds_qset_userdata(qos, _ENCLAVE, len(_ENCLAVE))
        self.participant: int = self._calls.dds_create_participant(number, qos, None)
        self._calls.dds_delete_qos(qos)
        if self.participant < 0:
            error = self._no_participant(self.participant)
            self._leave()
            raise error
        guid = ctypes.create_string_buffer(16)
        self._calls.dds_get_guid(self.participant, guid)
        self.guid = guid.raw
        """GUID of the participant."""
        try:
            self._test()
        except ConfigError:
            self.close()
            raise

    def topic(self, name: str, type_name: str) -> NativeTopic:
        """The topic of that name and type; counts one more user.

        Raises:
            ConfigError: DDS does not accept the name.
        """
        topic = self._topics.get((name, type_name))
        if topic is None:
            entity = self._make_topic(name, type_name)
            sample_type = type_of(self._library, entity) if self._library.knows_types else self._generic()
            topic = self._topics[name, type_name] = NativeTopic(entity, sample_type)
        topic.users += 1
        return topic

    def release(self, name: str, type_name: str) -> None:
        """End one use; the topic goes with its last user."""
        topic = self._topics[name, type_name]
        topic.users -= 1
        if not topic.users:
            del self._topics[name, type_name]
            self._calls.dds_delete(topic.entity)

    def close(self) -> None:
        """Leave the domain; everything in it is deleted, and the peers are told."""
        self._calls.dds_delete(self.participant)
        self._leave()

    def _leave(self) -> None:
        if self._own_domain is not None:
            self._calls.dds_delete(self._own_domain)
            self._own_domain = None

    def _make_topic(self, name: str, type_name: str) -> int:
        if too_long := next((one for one in (name, type_name) if len(one.encode()) > LONGEST_NAME), ""):
            raise ConfigError(f"{too_long[:40]!r}... cannot be in DDS: a name has at most {LONGEST_NAME} bytes")
        entity: int = self._calls.dds_create_topic(
            self.participant, byref(descriptor(type_name)), name.encode(), None, None
        )
        if entity < 0:
            raise ConfigError(
                f"topic {name!r} of type {type_name!r} cannot be in DDS ({self._library.describe(entity)}): "
                "names consist of letters, digits, _ and /"
            )
        return entity

    def _generic(self) -> int:
        """Version 0.10 does not report types: samples of one type serve for all, and the library converts them."""
        if self._generic_type is None:
            self._generic_topic = self._make_topic(f"{_SELF_TEST}/{os.urandom(8).hex()}", _SELF_TEST)
            with private_qos(self._library, user_data_of(_SELF_TEST)) as qos:
                self._generic_type = type_by_sample(self._library, self._generic_topic, self.participant, qos)
        return self._generic_type

    def _test(self) -> None:
        """Write octets to ourselves and compare."""
        calls, name = self._calls, f"{_SELF_TEST}/{os.urandom(8).hex()}"
        topic = self.topic(name, _SELF_TEST)
        with private_qos(self._library, user_data_of(_SELF_TEST)) as qos:
            reader = calls.dds_create_reader(self.participant, topic.entity, qos, None)
            writer = calls.dds_create_writer(self.participant, topic.entity, qos, None)
        serialiser = Serialiser(self._library)
        try:
            for body in _BODIES:
                code = serialiser.write(writer, topic.sample_type, body)
                taken = serialiser.take(reader)
                if code < 0 or taken is None or [octets for _, octets in taken] != [body]:
                    raise ConfigError(
                        f"DDS: {self._library.path} does not pass samples through as they are: another version will do"
                    )
        finally:
            calls.dds_delete(writer)
            calls.dds_delete(reader)
            self.release(name, _SELF_TEST)

    def _no_participant(self, code: int) -> ConfigError:
        port = 7400 + 250 * self.number
        return ConfigError(
            f"DDS domain {self.number} cannot be joined ({self._library.describe(code)}): its UDP ports, from {port} "
            "on, are taken, or no network interface is up; another domain will do, or an end to who holds the ports"
        )
