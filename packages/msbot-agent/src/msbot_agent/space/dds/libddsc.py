"""Finds libddsc, the C library of Cyclone DDS, and says which of its functions are used and how.

There are two sets of handles on one library. `calls` lets other threads run during the call and is for everything that
may wait. `quick` does not, because releasing the interpreter lock and taking it again costs more than the call: it is
for the path of a sample. Nothing in the library ever calls back into Python, so `quick` cannot get stuck.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib.util
import os
import re
from collections.abc import Iterator
from ctypes import POINTER, c_bool, c_char_p, c_int, c_int32, c_int64, c_size_t, c_ssize_t, c_uint32, c_uint64, c_void_p
from pathlib import Path

from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

REMEDY = (
    "pip install 'msbot-agent[dds]', or apt install libddsc0debian, or let CYCLONEDDS_HOME name where Cyclone DDS is"
)

OLDEST = (0, 10)
NEWEST = (11, 99)
"""Newest version (and `OLDEST` the oldest) whose internal layout is known; the self-test at the start is the proof."""

ALL_DOMAINS = 0x7FFF0000 + 256
"""The library itself as an entity: the parent of the entities that serve every domain."""
PUBLICATIONS = 0x7FFF0000 + 3
SUBSCRIPTIONS = 0x7FFF0000 + 4
"""Built-in topics that report discovered writers and readers."""

TIMEOUT = -10
PRECONDITION_NOT_MET = -4

FOR_EVER = 0x7FFFFFFFFFFFFFFF
"""A duration in nanoseconds that never ends."""

ANY_STATE = 0x7F
"""Take samples whatever their states."""

ALIVE = 16
"""State of an instance that has a writer and was not disposed of."""

DATA = 2
"""Kind of a serialised sample that has a value."""


class KeyDescriptor(ctypes.Structure):
    """Never filled in: no keys."""


class TypeMeta(ctypes.Structure):
    """Serialised description of a type; always empty here, so that no type is announced that could not match."""

    _fields_ = [("data", c_void_p), ("size", c_uint32)]


class TopicDescriptor(ctypes.Structure):
    """`dds_topic_descriptor_t` (ddsc/dds_public_impl.h), the same from 0.10 to 11."""

    _fields_ = [
        ("size", c_uint32),
        ("align", c_uint32),
        ("flags", c_uint32),
        ("key_count", c_uint32),
        ("type_name", c_char_p),
        ("keys", POINTER(KeyDescriptor)),
        ("op_count", c_uint32),
        ("ops", POINTER(c_uint32)),
        ("meta", c_char_p),
        ("type_information", TypeMeta),
        ("type_mapping", TypeMeta),
        ("representations", c_uint32),
    ]


class IoVec(ctypes.Structure):
    """`struct iovec`: a pointer and a length (Windows has them the other way round: see `as_octets`)."""

    _fields_ = (
        [("length", c_uint32), ("base", c_char_p)] if os.name == "nt" else [("base", c_char_p), ("length", c_size_t)]
    )


class SampleInfo(ctypes.Structure):
    """`dds_sample_info_t`."""

    _fields_ = [
        ("sample_state", c_uint32),
        ("view_state", c_uint32),
        ("instance_state", c_uint32),
        ("valid_data", c_bool),
        ("source_timestamp", c_int64),
        ("instance", c_uint64),
        ("publication", c_uint64),
        ("disposed_generations", c_uint32),
        ("no_writers_generations", c_uint32),
        ("sample_rank", c_uint32),
        ("generation_rank", c_uint32),
        ("absolute_generation_rank", c_uint32),
    ]


class BuiltinEndpoint(ctypes.Structure):
    """`dds_builtintopic_endpoint_t`: a writer or reader that was discovered."""

    _fields_ = [
        ("guid", ctypes.c_ubyte * 16),
        ("participant", ctypes.c_ubyte * 16),
        ("participant_handle", c_uint64),
        ("topic", c_char_p),
        ("type_name", c_char_p),
        ("qos", c_void_p),
    ]


class Matched(ctypes.Structure):
    """`dds_publication_matched_status_t` and its like for readers."""

    _fields_ = [
        ("total", c_uint32),
        ("total_change", c_int32),
        ("current", c_uint32),
        ("current_change", c_int32),
        ("last", c_uint64),
    ]


class Incompatible(ctypes.Structure):
    """`dds_offered_incompatible_qos_status_t` and its like for readers."""

    _fields_ = [("total", c_uint32), ("total_change", c_int32), ("policy", c_uint32)]


class Missed(ctypes.Structure):
    """`dds_offered_deadline_missed_status_t`, its like for readers, and (but for the last) `sample_lost`."""

    _fields_ = [("total", c_uint32), ("total_change", c_int32), ("last", c_uint64)]


class SampleRejected(ctypes.Structure):
    """`dds_sample_rejected_status_t`."""

    _fields_ = [("total", c_uint32), ("total_change", c_int32), ("reason", c_int), ("last", c_uint64)]


_ENTITY = c_int32
_BUFFERS = POINTER(c_void_p)

_SIGNATURES: dict[str, tuple[type | None, list[object]]] = {
    "dds_create_domain": (_ENTITY, [c_uint32, c_char_p]),
    "dds_create_participant": (_ENTITY, [c_uint32, c_void_p, c_void_p]),
    "dds_create_topic": (_ENTITY, [_ENTITY, POINTER(TopicDescriptor), c_char_p, c_void_p, c_void_p]),
    "dds_create_publisher": (_ENTITY, [_ENTITY, c_void_p, c_void_p]),
    "dds_create_subscriber": (_ENTITY, [_ENTITY, c_void_p, c_void_p]),
    "dds_create_writer": (_ENTITY, [_ENTITY, _ENTITY, c_void_p, c_void_p]),
    "dds_create_reader": (_ENTITY, [_ENTITY, _ENTITY, c_void_p, c_void_p]),
    "dds_create_readcondition": (_ENTITY, [_ENTITY, c_uint32]),
    "dds_create_waitset": (_ENTITY, [_ENTITY]),
    "dds_create_guardcondition": (_ENTITY, [_ENTITY]),
    "dds_set_guardcondition": (c_int32, [_ENTITY, c_bool]),
    "dds_waitset_attach": (c_int32, [_ENTITY, _ENTITY, c_ssize_t]),
    "dds_waitset_detach": (c_int32, [_ENTITY, _ENTITY]),
    "dds_waitset_wait": (c_int32, [_ENTITY, POINTER(c_ssize_t), c_size_t, c_int64]),
    "dds_set_status_mask": (c_int32, [_ENTITY, c_uint32]),
    "dds_get_publication_matched_status": (c_int32, [_ENTITY, POINTER(Matched)]),
    "dds_get_subscription_matched_status": (c_int32, [_ENTITY, POINTER(Matched)]),
    "dds_get_offered_incompatible_qos_status": (c_int32, [_ENTITY, POINTER(Incompatible)]),
    "dds_get_requested_incompatible_qos_status": (c_int32, [_ENTITY, POINTER(Incompatible)]),
    "dds_get_offered_deadline_missed_status": (c_int32, [_ENTITY, POINTER(Missed)]),
    "dds_get_requested_deadline_missed_status": (c_int32, [_ENTITY, POINTER(Missed)]),
    "dds_get_sample_lost_status": (c_int32, [_ENTITY, POINTER(Missed)]),
    "dds_get_sample_rejected_status": (c_int32, [_ENTITY, POINTER(SampleRejected)]),
    "dds_get_matched_publication_data": (POINTER(BuiltinEndpoint), [_ENTITY, c_uint64]),
    "dds_builtintopic_free_endpoint": (None, [POINTER(BuiltinEndpoint)]),
    "dds_get_guid": (c_int32, [_ENTITY, c_void_p]),
    "dds_take": (c_int32, [_ENTITY, _BUFFERS, POINTER(SampleInfo), c_size_t, c_uint32]),
    "dds_return_loan": (c_int32, [_ENTITY, _BUFFERS, c_int32]),
    "dds_write": (c_int32, [_ENTITY, c_void_p]),
    "dds_delete": (c_int32, [_ENTITY]),
    "dds_strretcode": (c_char_p, [c_int32]),
    "dds_create_qos": (c_void_p, []),
    "dds_delete_qos": (None, [c_void_p]),
    "dds_qset_reliability": (None, [c_void_p, c_int, c_int64]),
    "dds_qset_durability": (None, [c_void_p, c_int]),
    "dds_qset_durability_service": (None, [c_void_p, c_int64, c_int, c_int32, c_int32, c_int32, c_int32]),
    "dds_qset_history": (None, [c_void_p, c_int, c_int32]),
    "dds_qset_resource_limits": (None, [c_void_p, c_int32, c_int32, c_int32]),
    "dds_qset_deadline": (None, [c_void_p, c_int64]),
    "dds_qset_lifespan": (None, [c_void_p, c_int64]),
    "dds_qset_ownership": (None, [c_void_p, c_int]),
    "dds_qset_ownership_strength": (None, [c_void_p, c_int32]),
    "dds_qset_partition": (None, [c_void_p, c_uint32, POINTER(c_char_p)]),
    "dds_qset_ignorelocal": (None, [c_void_p, c_int]),
    "dds_qset_userdata": (None, [c_void_p, c_char_p, c_size_t]),
    "dds_qget_reliability": (c_bool, [c_void_p, POINTER(c_int), POINTER(c_int64)]),
    "dds_qget_durability": (c_bool, [c_void_p, POINTER(c_int)]),
    "dds_qget_ownership": (c_bool, [c_void_p, POINTER(c_int)]),
    "dds_qget_ownership_strength": (c_bool, [c_void_p, POINTER(c_int32)]),
    "dds_qget_deadline": (c_bool, [c_void_p, POINTER(c_int64)]),
    "dds_qget_partition": (c_bool, [c_void_p, POINTER(c_uint32), POINTER(POINTER(c_void_p))]),
    "dds_free": (None, [c_void_p]),
    "dds_writecdr": (c_int32, [_ENTITY, c_void_p]),
    "dds_takecdr": (c_int32, [_ENTITY, _BUFFERS, c_uint32, POINTER(SampleInfo), c_uint32]),
    "ddsi_serdata_from_ser_iov": (c_void_p, [c_void_p, c_int, c_size_t, POINTER(IoVec), c_size_t]),
    "ddsi_serdata_size": (c_uint32, [c_void_p]),
    "ddsi_serdata_to_ser": (None, [c_void_p, c_size_t, c_size_t, c_void_p]),
    "ddsi_serdata_unref": (None, [c_void_p]),
}

_SINCE_11: dict[str, tuple[type | None, list[object]]] = {
    "dds_get_entity_sertype": (c_int32, [_ENTITY, POINTER(c_void_p)]),
}


@dataclass(frozen=True, slots=True)
class DdsLibrary:
    """A libddsc that has every function we use."""

    calls: ctypes.CDLL
    """Lets other threads run during a call."""
    quick: ctypes.PyDLL
    """Keeps other threads from running; for calls that never wait."""
    path: str
    knows_types: bool
    """Whether it reports the type of an entity (since 11); with older versions the type is read from a sample."""

    def describe(self, code: int) -> str:
        """What a return code means."""
        text: bytes = self.calls.dds_strretcode(code)
        return text.decode("ascii", "replace")


def load() -> DdsLibrary:
    """The first libddsc there is: below CYCLONEDDS_HOME if that is set, else the wheel's, else the system's.

    Raises:
        ConfigError: there is none, or it lacks a function that is needed; the text says what to do.
    """
    failures = []
    for path in places():
        try:
            return _open(path)
        except OSError as error:
            failures.append(f"{path} cannot be loaded ({error})")
        except AttributeError as error:
            failures.append(f"{path} is of a version that MsBOT does not know ({_missing(error)})")
    if failures:
        raise ConfigError(f"DDS: {'; '.join(failures)}: versions 0.10 to 11 will do: {REMEDY}")
    home = os.environ.get("CYCLONEDDS_HOME")
    if home:
        raise ConfigError(f"DDS: CYCLONEDDS_HOME is {home}, and there is no libddsc in its lib folder: {REMEDY}")
    raise ConfigError(f"DDS needs libddsc, the library of Cyclone DDS, and it is not here: {REMEDY}")


def places() -> Iterator[str]:
    """The places where libddsc may be, best first."""
    home = os.environ.get("CYCLONEDDS_HOME")
    if home:
        for folder in ("lib", "lib64", "bin", "lib/x86_64-linux-gnu", "lib/aarch64-linux-gnu"):
            for pattern in ("libddsc.so*", "libddsc*.dylib", "ddsc.dll"):
                yield from (str(path) for path in sorted((Path(home) / folder).glob(pattern))[:1])
        return  # a place that the user named is the only one to try
    wheel = _wheel_folder()
    if wheel is not None:
        for place in (wheel.parent / "cyclonedds.libs", wheel / ".dylibs"):
            yield from (str(path) for path in sorted(place.glob("*ddsc*")) if path.name.startswith(("libddsc", "ddsc")))
    system = ctypes.util.find_library("ddsc")
    if system is not None:
        yield system
    else:
        yield from sorted(str(path) for path in Path("/usr/lib").glob("*/libddsc.so.0*"))[:1]


def _wheel_folder() -> Path | None:
    spec = importlib.util.find_spec("cyclonedds")
    if spec is None or not spec.submodule_search_locations:
        return None
    return Path(next(iter(spec.submodule_search_locations)))


def _open(path: str) -> DdsLibrary:
    version = re.search(r"(\d+)\.(\d+)\.\d+(?:\.dylib)?$", os.path.realpath(path))
    if version and not OLDEST <= (int(version[1]), int(version[2])) <= NEWEST:
        raise OSError(f"it is version {version[1]}.{version[2]}")
    library = DdsLibrary(ctypes.CDLL(path), ctypes.PyDLL(path), path, knows_types=False)
    knows_types = hasattr(library.calls, "dds_get_entity_sertype")
    signatures = {**_SIGNATURES, **(_SINCE_11 if knows_types else {})}
    for handle in (library.calls, library.quick):
        for name, (result, arguments) in signatures.items():
            function = getattr(handle, name)
            function.restype = result
            function.argtypes = arguments
    return DdsLibrary(library.calls, library.quick, path, knows_types)


def _missing(error: AttributeError) -> str:
    match = re.search(r"undefined symbol: (\w+)", str(error))
    return f"it lacks {match[1]}" if match else str(error)
