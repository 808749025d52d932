"""Messages: a class with annotations becomes a value that travels as CDR.

::

    class Light(Message):
        lux: float32

    Light(lux=3.5).encode()                # b"\x00\x00\x60\x40"
    Light.decode(b"\x00\x00\x60\x40").lux  # 3.5

Fields are written in the order of the class, those of a base class first. What each type looks like is in
`wire_types`.
"""

from __future__ import annotations

import copy
import struct
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import (
    TYPE_CHECKING,
    ClassVar,
    Self,
    TypeAlias,
    TypeVar,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from msbot.part.messages.wire_types import FieldCodec, codec_for
from msbot.part.program_mistakes import tell_mistakes_as_sentences
from msbot_xrce.errors import LocalProtocolError, MsbotError, RemoteProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import CdrReader, CdrWriter

# Messages of a fixed size, packed and unpacked in one go: much cheaper for a `Twist` than its six numbers one by one.
#
# A message whose fields are all numbers and booleans, also inside nested messages, has the same octets at the same
# places every time, so one `struct.Struct` with the padding of CDR in it does all the work. Anything out of the
# ordinary is left to the slower way, field by field, which has the error messages for it.


Leaf: TypeAlias = tuple[str, str]
"""Path of a number inside a message (`linear.x`), and its code in a `struct` format."""
Branch: TypeAlias = "tuple[type, tuple[tuple[str, int | Branch], ...]]"
"""A message class, and for each field the index of its value, or a nested message."""


@dataclass(frozen=True, slots=True)
class FixedSize:
    """How every message of one class looks on the wire."""

    leaves: tuple[Leaf, ...]
    """The numbers in the order of the wire."""
    tree: Branch
    layout: struct.Struct
    get: Callable[[object], tuple[object, ...]]
    """The values of a message in the order of the wire."""
    booleans: tuple[int, ...]
    """Offsets of octets that may only be 0 or 1."""

    def encode(self, message: object) -> bytes | None:
        """The message as CDR; None when a value does not fit."""
        try:
            return self.layout.pack(*self.get(message))
        except (struct.error, OverflowError):
            return None

    def decode(self, data: bytes) -> object | None:
        """The message at the beginning of the octets; None when they cannot be one."""
        if len(data) < self.layout.size:
            return None
        for offset in self.booleans:
            if data[offset] > 1:
                return None
        return _grow(self.tree, self.layout.unpack_from(data))


def fixed_size(cls: type, fields: Mapping[str, str | FixedSize | None]) -> FixedSize | None:
    """How the messages of a class look on the wire; None when their size is not fixed.

    Args:
        cls: the class.
        fields: for each field its code in a `struct` format, or a nested message, or None for anything else.
    """
    leaves: list[Leaf] = []
    branch: list[tuple[str, int | Branch]] = []
    for name, inside in fields.items():
        if inside is None:
            return None
        if isinstance(inside, str):
            branch.append((name, len(leaves)))
            leaves.append((name, inside))
        else:
            branch.append((name, _moved(inside.tree, len(leaves))))
            leaves += [(f"{name}.{path}", code) for path, code in inside.leaves]
    if not leaves:
        return None
    layout, booleans = _layout(leaves)
    return FixedSize(tuple(leaves), (cls, tuple(branch)), layout, _getter(leaves), booleans)


def _layout(leaves: list[Leaf]) -> tuple[struct.Struct, tuple[int, ...]]:
    form, offset, booleans = "<", 0, []
    for _, code in leaves:
        size = struct.calcsize(f"<{code}")
        padding = -offset % size
        form += "x" * padding + code
        offset += padding
        if code == "?":
            booleans.append(offset)
        offset += size
    return struct.Struct(form), tuple(booleans)


def _getter(leaves: list[Leaf]) -> Callable[[object], tuple[object, ...]]:
    get = attrgetter(*(path for path, _ in leaves))
    return get if len(leaves) > 1 else lambda message: (get(message),)


def _moved(tree: Branch, by: int) -> Branch:
    cls, fields = tree
    return cls, tuple((name, at + by if isinstance(at, int) else _moved(at, by)) for name, at in fields)


def _grow(tree: Branch, values: tuple[object, ...]) -> object:
    cls, fields = tree
    message: object = object.__new__(cls)
    inside = message.__dict__  # values from the wire always fit: no need to check each one when it is set
    for name, at in fields:
        inside[name] = values[at] if type(at) is int else _grow(at, values)  # type: ignore[arg-type]
    return message


LARGEST_PADDING = 3
"""Octets after the last field that are accepted as padding: some DDS writers fill up to a multiple of 4."""

LONGEST_SHOWN = 60
"""Characters of a wrong value that an error text shows."""

_M = TypeVar("_M", bound="Message")


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message class."""

    name: str
    codec: FieldCodec
    default: object
    """Value of a message that does not set the field; copied when the type can change in place."""


@dataclass_transform(kw_only_default=True)
class Message:
    """Base of everything that travels on a topic or in a service; subclass it and annotate the fields.

    A field that is not given gets the default from the class body, else zero (`0`, `False`, `""`, `b""`, `[]`, a nested
    message of zeros). Values are checked when they are set and again when they are encoded.
    """

    type_name: ClassVar[str] = "Message"
    """Type name in the data space; the name of the class unless the class says otherwise."""
    _fields: ClassVar[dict[str, Field]] = {}
    _fixed: ClassVar[FixedSize | None] = None
    """How such messages are packed in one go; None when their size is not fixed."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "type_name" not in cls.__dict__:
            cls.type_name = cls.__name__
        cls._fields = _compile(cls)
        cls._fixed = fixed_size(cls, {name: _fixed_form(field) for name, field in cls._fields.items()})

    def __init__(self, *positional: object, **values: object) -> None:
        if positional:
            fields = ", ".join(f"{name}=..." for name in self._fields)
            what = type(self).__name__
            raise LocalProtocolError(f"{what} takes its fields by name: {what}({fields})")
        for name, field in self._fields.items():
            if name in values:
                setattr(self, name, values.pop(name))
            else:
                default = copy.deepcopy(field.default) if field.codec.fragile else field.default
                object.__setattr__(self, name, default)
        if values:
            raise TypeError(_no_such_field(type(self), next(iter(values))))

    if not TYPE_CHECKING:  # a type checker that saw this would allow any attribute to be set

        def __setattr__(self, name: str, value: object) -> None:
            _assign(self, name, value)

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self) and not (
            isinstance(other, Message) and _is_same_type(type(self), type(other))
        ):
            return NotImplemented
        return all(getattr(self, name) == getattr(other, name) for name in self._fields)

    __hash__: ClassVar[None] = None  # type: ignore[assignment]  # it is mutable, as is a dataclass with __eq__

    def __repr__(self) -> str:
        inside = ", ".join(f"{name}={getattr(self, name)!r}" for name in self._fields)
        return f"{type(self).__name__}({inside})"

    def encode(self) -> bytes:
        """The message as CDR, little endian, without encapsulation header.

        Raises:
            LocalProtocolError: a list or nested message was changed to something that does not fit.
        """
        if self._fixed is not None and (octets := self._fixed.encode(self)) is not None:
            return octets
        writer = CdrWriter()
        for name, field in self._fields.items():
            value = getattr(self, name)
            if field.codec.fragile and not field.codec.fits(value):
                raise LocalProtocolError(_misfit(type(self), field, value))
            field.codec.write(writer, value)
        return writer.finish()

    @classmethod
    def decode(cls, data: bytes, *, most_behind: int = LARGEST_PADDING) -> Self:
        """The message in the octets; up to `most_behind` octets of padding may follow it.

        Raises:
            RemoteProtocolError: the octets are not a message of this class.
        """
        fixed = cls._fixed
        if fixed is not None and len(data) - fixed.layout.size <= most_behind:
            found = fixed.decode(data)
            if isinstance(found, cls):
                return found
        reader = CdrReader(data)
        message = _read(cls, reader)
        if reader.remaining > most_behind:
            words = f"{reader.remaining} bytes left over after {cls.type_name}: is it another type?"
            raise RemoteProtocolError(words)
        return message


class MessageClassError(MsbotError, TypeError):
    """A message class of a program is wrong; the text says which field, and what would be right."""


_SIZED = {int: "int32 (or int8, int16, int64, uint8 to uint64)", float: "float32 (or float64)"}


def _mistake(words: str) -> MessageClassError:
    """The error of a class, which a program that has made no part yet tells as a sentence as well."""
    tell_mistakes_as_sentences()
    return MessageClassError(words)


def fields_of(message_class: type[Message]) -> tuple[Field, ...]:
    """The fields of a message class in the order of the wire."""
    return tuple(message_class._fields.values())


def _compile(cls: type[Message]) -> dict[str, Field]:
    try:
        hints = get_type_hints(cls, include_extras=True)
    except NameError as error:
        words = f"class {cls.__name__}: {error}; types must be known where the class is defined"
        raise _mistake(words) from error
    fields = {}
    for name, annotation in hints.items():
        if get_origin(annotation) is not ClassVar:
            fields[name] = _field(cls, name, annotation)
    return fields


def _is_same_type(one: type[Message], other: type[Message]) -> bool:
    """Whether two classes are one type: a program that is run and imported has each of its classes twice."""
    return one.type_name == other.type_name and _forms(one) == _forms(other)


def _forms(cls: type[Message]) -> list[object]:
    return [
        (field.name, field.codec.kind or field.codec.word, _forms(inside) if issubclass(inside, Message) else None)
        for field in fields_of(cls)
        for inside in (field.codec.inside or object,)
    ]


def converted(message: Message, wanted: type[_M]) -> _M | None:
    """A message of another class of the same type as one of the wanted class; None: it is another type."""
    if isinstance(message, wanted) and type(message) is wanted:
        return message
    return wanted.decode(message.encode()) if _is_same_type(type(message), wanted) else None


def fixed_form(cls: type[Message]) -> FixedSize | None:
    """How the messages of a class are packed in one go; None when their size is not fixed."""
    return cls._fixed


def _fixed_form(field: Field) -> str | FixedSize | None:
    zero = field.codec.zero
    return fixed_form(zero) if isinstance(zero, type) and issubclass(zero, Message) else field.codec.code


def _without_form(annotation: object) -> object:
    """What in an annotation has no form on the wire: of `Annotated[list[float], AtMost(4)]`, `float`."""
    inside = get_args(annotation)[:1]
    if inside and codec_for(inside[0], _record) is None:
        return _without_form(inside[0])
    return annotation


def _field(cls: type[Message], name: str, annotation: object) -> Field:
    where = f"class {cls.__name__}: field {name}"
    if name.startswith("_") or hasattr(Message, name):
        raise _mistake(f"{where} needs another name: this one belongs to Message")
    codec = codec_for(annotation, _record)
    if codec is None:
        wrong = _without_form(annotation)
        words = getattr(wrong, "__name__", None) or str(wrong)
        sized = _SIZED.get(wrong) if isinstance(wrong, type) else None
        if sized is not None:
            raise _mistake(f"{where}: {words} says no size on the wire: write {sized}")
        known = (
            "uint8 to uint64, int8 to int64, float32, float64, bool, str, bytes, list[...], an IntEnum, a Message class"
        )
        raise _mistake(f"{where}: {words} has no form on the wire; use one of {known}")
    default = getattr(cls, name, None)
    if default is None:
        default = codec.zero()
    field = Field(name, codec, default)
    if not codec.fits(default):
        raise _mistake(_misfit(cls, field, default))
    return field


def _record(annotation: object) -> FieldCodec | None:
    if not (isinstance(annotation, type) and issubclass(annotation, Message)):
        return None
    cls = annotation
    codecs = [(name, field.codec) for name, field in cls._fields.items()]

    def fits(value: object) -> bool:
        return type(value) is cls and all(codec.fits(getattr(value, name)) for name, codec in codecs)

    def write(writer: CdrWriter, value: Message) -> None:
        for name, codec in codecs:
            codec.write(writer, getattr(value, name))

    def read(reader: CdrReader) -> Message:
        return _read(cls, reader)

    smallest = sum(codec.smallest for _, codec in codecs)
    return FieldCodec(
        cls.__name__,
        f"a {cls.__name__} with {', '.join(cls._fields)}",
        smallest,
        cls,
        fits,
        write,
        read,
        fragile=True,
        kind=cls.type_name,
        inside=cls,
    )


def _read(cls: type[_M], reader: CdrReader) -> _M:
    message = cls.__new__(cls)
    for name, field in cls._fields.items():
        object.__setattr__(message, name, field.codec.read(reader))
    return message


def _assign(message: Message, name: str, value: object) -> None:
    cls = type(message)
    field = cls._fields.get(name)
    if field is None:
        raise AttributeError(_no_such_field(cls, name))
    if not field.codec.fits(value):
        raise LocalProtocolError(_misfit(cls, field, value))
    object.__setattr__(message, name, value)


def _no_such_field(cls: type[Message], name: str) -> str:
    return f"{cls.__name__} has no field {name!r}; it has {', '.join(cls._fields) or 'none'}"


def _misfit(cls: type[Message], field: Field, value: object) -> str:
    name, codec = field.name, field.codec
    while (inner := _misfit_inside(codec, value)) is not None:
        step, codec, value = inner
        name += step
    if codec.most is not None and isinstance(value, type(codec.zero())) and (fault := codec.size_fault(value)):
        return f"{cls.__name__}.{name} {fault}"
    shown = repr(value)
    if len(shown) > LONGEST_SHOWN:
        shown = f"{shown[:LONGEST_SHOWN]}..."
    return f"{cls.__name__}.{name} cannot be {shown}: {codec.word} needs {codec.needs}"


def _misfit_inside(codec: FieldCodec, value: object) -> tuple[str, FieldCodec, object] | None:
    """The first element or field in a value that does not fit, with its place in words; None: the value as a whole."""
    if codec.element is not None and codec.fragile and isinstance(value, list):
        for place, one in enumerate(value):
            if not codec.element.fits(one):
                return f"[{place}]", codec.element, one
    elif isinstance(value, Message) and type(value) is codec.inside:
        for field in fields_of(type(value)):
            if not field.codec.fits(one := getattr(value, field.name)):
                return f".{field.name}", field.codec, one
    return None
