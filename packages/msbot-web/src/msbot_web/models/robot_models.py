"""What API (`/openapi.json`) and pages say of a robot: one model per thing, with meaning and unit of every field.

Ages and rates are worked out at the moment of asking, so nobody has to share a clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any, ParamSpec, TypeVar, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from msbot_agent.text.sentence import whole
from msbot_web.models.sentence_field import SentenceField

# What all models of the API have in common.


@contextmanager
def _built_at_first_use() -> Iterator[None]:
    """Models that are made here get their validators when one of them is first used."""
    BaseModel.model_config["defer_build"] = True
    try:
        yield
    finally:
        del BaseModel.model_config["defer_build"]


with _built_at_first_use():
    # Those of an OpenAPI description: a quarter of what it takes to load FastAPI, and hardly ever used.
    import fastapi.openapi.models  # noqa: F401


class Model(BaseModel):
    """Base: values are never changed, and unknown fields in a request are an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


_P = ParamSpec("_P")
_T = TypeVar("_T")


def unchecked(model: Callable[_P, _T]) -> Callable[_P, _T]:
    """A model without its checks, for what is made of a robot's own values many times a second.

    Every field has to be given, by name, as the model would have it.
    """
    kind, put = cast("type[Model]", model), object.__setattr__
    names = set(kind.model_fields)

    def make(*_nothing: _P.args, **fields: _P.kwargs) -> _T:
        made: Any = kind.__new__(kind)
        put(made, "__dict__", fields)
        put(made, "__pydantic_fields_set__", names)
        put(made, "__pydantic_extra__", None)
        put(made, "__pydantic_private__", None)
        return cast("_T", made)

    return make


# What a part says of itself, and the wires that would fit it, as pages and API show them.


class PortDeclaration(Model):
    """A port that a part says it has."""

    name: str
    direction: str
    """`publish` or `subscribe`."""
    type: str
    fields: list[str]
    """The fields of its messages with their units."""
    safe: str
    """Its safe value in words; empty: none."""


class SettingDeclaration(Model):
    """A setting that a part says it has."""

    name: str
    default: str
    least: float | None
    most: float | None
    unit: str


class PartDeclaration(Model):
    """What a part says of itself: data of a stranger, checked, and not in force."""

    name: str = ""
    """What it is, in a few words."""
    description: str = ""
    ports: list[PortDeclaration] = Field(default_factory=list)
    settings: list[SettingDeclaration] = Field(default_factory=list)
    checked: bool
    """Whether it can be adopted."""
    fault: SentenceField = ""
    """Why it is refused."""


class WireOffer(Model):
    """A wire that fits by its type: the arguments of `POST /topics/{topic}/bind`."""

    topic: str
    type: str
    source: str = Field(alias="from")
    to: list[str]


# How the session of a part has gone, as pages and API show it.


class SessionFaults(Model):
    """What went wrong between the agent and a part since its session was opened."""

    repeated: int
    """Messages of the part that came twice, or too late."""
    resent: int
    """Messages that were sent to it again."""
    unread: int
    """Samples for it that were thrown away because it takes them too slowly."""


Scalar = bool | int | float | Annotated[str, AfterValidator(whole)]
"""Without halves of characters, which pydantic lets pass in a union, and nobody can answer with."""


class ChangeResult(Model):
    """A change was made."""

    words: SentenceField
    """What happened, for people."""
    edit: int | None = None
    """Its number, for undo; absent when it cannot be undone."""
    offers: list[WireOffer] = Field(default_factory=list)
    """Wires that would fit the new slot of a part that described itself."""
    for_people: list[WireOffer] = Field(default_factory=list)
    """Wires of its own for its other ports that publish or serve: people look at them, or call."""
    by_hand: list[WireOffer] = Field(default_factory=list)
    """The same for ports that hear: people send to them."""
    reply: dict[str, Scalar] = Field(default_factory=dict)
    """The reply to a call, by its fields."""


class StopResult(ChangeResult):
    """STOP was said."""

    stop: int
    """Its number, for GO."""
    stored: bool
    """Whether it survives a restart of the master."""
    trouble: SentenceField = ""
    """Why it would not; empty: it would."""


class Me(Model):
    """Who is signed in."""

    name: str
    role: str
    rights: list[str]
    csrf: str
    """What a changing request shows in the header `X-CSRF-Token` when it comes with the cookie."""


class SafeLine(Model):
    """A field of the safe value of a slot's port."""

    port: str
    field: str
    value: Scalar
    unit: str
    origin: str
    """`library` or `blueprint`: who says so."""
    stops_by: str = ""
    """What STOP does instead; empty: STOP brings this value, too."""


class Value(Model):
    """One parameter of a slot."""

    name: str
    kind: str
    """`bool`, `int`, `float` or `text`."""
    value: Scalar
    default: Scalar
    origin: str
    """`library`, `blueprint` or `hand`: where the value comes from."""
    unit: str = ""
    least: float | None = None
    most: float | None = None
    description: str = ""
    who: str = ""
    """Who set it by hand."""


class PortLine(Model):
    """One port of a slot and its topic."""

    port: str
    topic: str
    type_name: str
    publishes: bool
    reliable: bool
    rate_hz: float = 0.0
    count: int = 0
    """Samples on the topic since the server began to listen."""
    age_s: float | None = None
    """Since the latest sample."""
    fields: dict[str, Scalar] = Field(default_factory=dict)
    """The latest sample, by field."""
    stale: bool = False
    """Whether the latest sample is older than three periods, or its sender is not there any more."""
    held: str = ""
    """Why an actuator does not do what the sample says: `stopped` (it has confirmed STOP), `unconfirmed` (it has been
    told STOP and has not answered: what it does is not known), `partner lost`, `by hand` (somebody drives it instead of
    the wire; the fields are theirs), `gone` (no part is there to do it); empty: it does."""
    safe: dict[str, Scalar] = Field(default_factory=dict)
    """What the part applies to itself while it is held; empty: it keeps on."""


class PartLine(Model):
    """A part as the inventory shows it."""

    part: str
    part_number: str
    local_name: str
    uid: str
    """16 hexadecimal digits, empty when it has none."""
    slot: str
    """The slot it holds or held, empty when none."""
    state: str
    """`new`, `checking`, `active`, `late`, `lost`, `refused`, `standby` or `left`."""
    reason: SentenceField
    state_age_s: float
    life: int
    beat_age_s: float | None
    beats: int
    plug_in_to_active_ms: float | None
    client_key: str
    address: str
    refused_claims: int
    duplicates: list[str]
    ignored: bool = False
    nature: str = ""
    """`real` or `simulated`, as the part itself says; empty when it does not."""
    hardware: str = ""
    software: str = ""
    """Versions, as the part itself says; empty when it does not."""
    home: str = ""
    """Where it runs, as it says: `PC`, `MicroPython`, `C`, `browser` or `bridge`; empty when it does not."""
    msbot: str = ""
    """The version of MsBOT there."""
    says: PartDeclaration | None = None
    """What it says of itself, while the library does not know its part number."""
    refusal: str = ""
    """Why it was refused or stands by, in a word for programs, as `blocked` or `no_slot`; empty: it is let in."""


TOLD = ("actuator", "display")
"""Categories of parts of which what they were told says more than what they tell."""


class SlotCard(Model):
    """One slot of the robot with the part in it."""

    name: str
    part_number: str
    type_name: str
    """What `shown_number` is, in words; empty when the library does not know it."""
    category: str = ""
    description: str
    state: str
    """The part's state, or `empty`."""
    reason: SentenceField
    part: PartLine | None
    ports: list[PortLine]
    next_beat_s: float | None
    """Until the next beat is expected; negative: overdue."""
    spares: list[str] = Field(default_factory=list)
    """Parts that stand by and fit, by name: one of them takes over when the slot becomes free."""
    simulated: bool
    """Whether the part runs in this process and can be operated here."""
    plugged: bool | None
    """For a simulated part: whether it is on the wire."""
    faults: list[SentenceField] = Field(default_factory=list, description="What may be told of planted faults.")
    type_differences: list[SentenceField] = Field(
        default_factory=list, description="Ports whose messages are others in the part's program than in the library."
    )
    wear: SessionFaults | None = None

    @property
    def shown_number(self) -> str:
        """The part number that people read: that of the part in the slot, else that which the slot is for."""
        return (self.part.part_number if self.part is not None else "") or self.part_number

    @property
    def main_port(self) -> PortLine | None:
        """The port that says most about the part: what an actuator was told, else what the part tells."""
        ports = sorted(self.ports, key=lambda port: port.publishes is (self.category in TOLD))
        return next((port for port in ports if port.fields), self.ports[0] if self.ports else None)


class SimulatedPartControl(Model):
    """Something a person can do to a simulated part."""

    name: str
    kind: str
    """`bool`, `number`, `choice` or `text`."""
    least: float | None = None
    most: float | None = None
    unit: str = ""
    choices: list[str] = Field(default_factory=list)
    words: str = ""
    value: Scalar | None = None
    momentary: bool = False
    """Goes back by itself when it is let go, as a push button does."""


class Simulated(Model):
    """A simulated part: what can be done to it and what one would see of it."""

    slot: str
    plugged: bool
    controls: list[SimulatedPartControl]
    readings: dict[str, Scalar]


class PartStopConfirmation(Model):
    """A part that has said it is in its safe state."""

    part: str
    ms: float
    """From STOP to its confirmation."""


class StopState(Model):
    """The state of STOP."""

    stopped: bool = False
    number: int = 0
    """The STOP that was said last; a GO names it."""
    by: str = ""
    also_by: list[str] = Field(default_factory=list)
    """Who else has said STOP while it held."""
    place: SentenceField = ""
    """From where; empty: not known."""
    reason: SentenceField = ""
    since_s: float | None = None
    """How long it has held."""
    confirmed: list[PartStopConfirmation] = Field(default_factory=list)
    silent: list[str] = Field(default_factory=list)
    """Parts that have not confirmed it: they may still move."""
    trouble: SentenceField = ""
    """Why it would not survive a restart of the master; empty: it would."""


class Robot(Model):
    """The robot as a whole."""

    name: str
    version: str
    serial_number: str
    released: str
    manufacturer: str
    links: list[str]
    beat_s: float
    tick_s: float
    life: int
    stopped: bool
    """Whether STOP was pressed and nobody has said go on."""
    stop: StopState = Field(default_factory=StopState)
    """Who said it, and which parts have confirmed it."""
    window_s: float
    """Seconds the adoption window is still open; 0 = closed."""
    trouble: SentenceField
    """Why changes are not being stored, empty when all is well."""
    slots: list[SlotCard]
    arrivals: int
    """Parts that wait in the arrivals tray."""
    faults: list[SentenceField] = Field(default_factory=list)
    """Faults of the robot as a whole."""


class TopicLine(Model):
    """One topic with who writes and reads it."""

    topic: str
    type_name: str
    publishers: list[str]
    subscribers: list[str]
    rate_hz: float
    count: int
    fields: dict[str, Scalar]


class WirePort(Model):
    """A port of a slot, wired or not."""

    slot: str
    port: str
    type_name: str
    publishes: bool
    topic: str = ""
    """What it is wired to; empty: nothing."""


class SpanLine(Model):
    """A state of a slot, from its begin to the next one's."""

    begin_age_s: float
    end_age_s: float
    """0 = it still holds."""
    state: str
    part: str
    reason: SentenceField


class TimelineLane(Model):
    """A slot's states over time."""

    slot: str
    spans: list[SpanLine]


class JournalLine(Model):
    """One line of the journal."""

    number: int
    at_ms: int
    """Milliseconds since 1970."""
    part: str
    slot: str
    from_state: str
    to_state: str
    reason: SentenceField
    evidence: list[tuple[SentenceField, SentenceField]]


class EditLine(Model):
    """A change that a person made."""

    number: int
    at_ms: int
    who: str
    kind: str
    slot: str
    words: SentenceField
    undone: bool
    undoable: bool = False
    """Whether it can be undone: a STOP cannot."""


class TypeLine(Model):
    """An entry of the part library."""

    number: str
    name: str
    manufacturer: str
    description: str
    category: str
    ports: list[str]


class UserLine(Model):
    """A person who may sign in."""

    name: str
    role: str
    tokens: list[str]
    """What their API tokens are for."""
    tickets: list[str] = Field(default_factory=list)
    """For which relays and agents they have made tickets."""


class RelayTicket(Model):
    """A ticket with which a relay or an agent brings parts."""

    name: str
    """The teacher who answers for them."""
    purpose: str
    """Which relay or agent it is for."""


class NewUser(Model):
    """A person who is to be able to sign in."""

    name: str
    role: str
    password: str


class UserChange(Model):
    """What to change about a user; what is absent stays."""

    role: str | None = None
    password: str | None = None
    old_password: str | None = None
    """The present password, which people have to say to change their own."""


class NewToken(Model):
    """A new API token: shown once."""

    token: str


class TextBody(Model):
    """A text from a person."""

    words: str = Field(default="", max_length=1000)


class SimulatedPartControlValue(Model):
    """What a control of a simulated part is put to."""

    value: Scalar | None = None


class BlueprintText(Model):
    """A `robot.toml`."""

    toml: str = Field(max_length=256 * 1024)


class BlueprintDiff(Model):
    """What applying a blueprint would change, a line each; empty: nothing."""

    changes: list[SentenceField]
