"""The table of operations: each thing a person can do to a robot, or ask about it, once.

Commands, API calls, actions of the pages, requests of other processes and lines of the journal are made from it. To add
an operation, add a row here and a method of the same name to the class that carries it out (`carried_out` says where to
look); CONTRIBUTING names the pages and tests that follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from msbot.operations.operation import Argument, ArgumentKind, EditLog, Operation, OperationScope
from msbot.operations.rights import Right


def _slot(words: str, *, option: str = "", is_needed: bool = True) -> Argument:
    return Argument("slot", is_needed=is_needed, option=option, shown_as="SLOT", help=words)


def _part(words: str) -> Argument:
    return Argument("part", is_needed=True, shown_as="PART", help=words)


def _topic() -> Argument:
    return Argument("topic", is_needed=True, shown_as="TOPIC", help="Name of the topic.")


def _topic_type() -> Argument:
    return Argument("type", parameter="type_name", shown_as="[TYPE]", help="Its message type; needed for a free topic.")


def _pupil() -> Argument:
    return Argument("pupil", is_needed=True, longest=64, shown_as="PUPIL", help="Name of the pupil.")


def _group() -> Argument:
    return Argument("group", is_needed=True, longest=64, shown_as="GROUP", help="Name of the group.")


_LIST = 20_000
"""Characters of the longest value: a list of 4,096 bytes as JSON."""
_REASON_HELP = "Why; shown by `msbot why`."

_ROWS = (
    Operation(
        "adopt", "Put a part into a slot, even if the library does not know it.",
        (_part("A part that is in no slot."),
         _slot("The slot that it gets; default: the only empty slot that fits.", option="--slot", is_needed=False)),
        Right.ARRANGE, OperationScope.ANYWHERE, EditLog.UNDOABLE, "place", "POST /parts/{part}/adopt",
    ),
    Operation(
        "swap", "Give a slot to another part.",
        (_slot("The slot."),
         Argument("to", is_needed=True, parameter="part", option="--to", shown_as="PART",
                  help="The part that gets the slot.")),
        Right.ARRANGE, OperationScope.ANYWHERE, EditLog.UNDOABLE, "place", "POST /slots/{slot}/swap",
        "SLOT keeps its settings, wiring and history. The part that held it gets the other one's slot, or stands by.",
    ),
    Operation(
        "spare", "Let a part of another kind stand by for a slot.",
        (_slot("The slot."), Argument("part", is_needed=True, shown_as="PART", help="The part: another maker's, say."),
         Argument("agreed", ArgumentKind.FLAG, default=False, option="--agreed",
                  help="Accept the loss of the ports and settings that it lacks.")),
        Right.DESIGN, OperationScope.RUNNING, EditLog.LINE, "library", "POST /slots/{slot}/spare",
        "Its part number fits slots of that kind from then on. First lists what would be lost.",
    ),
    Operation(
        "release", "Take the part out of a slot.",
        (_slot("The slot."),),
        Right.ARRANGE, OperationScope.ANYWHERE, EditLog.UNDOABLE, "place", "POST /slots/{slot}/release",
        "The part stands by, and a spare gets the slot if there is one.",
    ),
    Operation(
        "forget_part", "Forget a part that is gone.",
        (_part("A part that is not plugged in: its name, part number or UID."),),
        Right.ARRANGE, OperationScope.ANYWHERE, EditLog.UNDOABLE, "place", "DELETE /parts/{part}",
        "The robot keeps no slot for it, and lists it no longer; the journal keeps its lines. If it comes again, it is "
        "a new part.",
    ),
    Operation(
        "simulate", "Replace the part in a slot by a simulated one, or end that.",
        (_slot("The slot."),
         Argument("end", ArgumentKind.FLAG, default=False, option="--end",
                  help="End it: the former part gets the slot back.")),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /slots/{slot}/simulate",
        "The part that held the slot stands by meanwhile. Simulated parts end with the master.",
    ),
    Operation(
        "window", "Open the adoption window: let parts be adopted that the library would turn away.",
        (Argument("seconds", ArgumentKind.NUMBER, default=60.0, least=1.0, most=3600.0, help="How long it stays open."),
         _slot("An empty slot that the next newcomer gets.", is_needed=False)),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "window", "POST /window",
    ),
    Operation(
        "close_window", "Close the adoption window.",
        (), Right.ARRANGE, OperationScope.RUNNING, EditLog.NOTHING, "", "DELETE /window",
    ),
    Operation(
        "block", "Keep out a part, or all parts of one part number.",
        (_part("A name, slot or UID; or a part number, for all parts of that kind."),
         Argument("reason", default="", longest=1000, option="--reason", shown_as="TEXT", help=_REASON_HELP)),
        Right.ARRANGE, OperationScope.ANYWHERE, EditLog.UNDOABLE, "block", "POST /parts/{part}/block",
        "PART is a name, slot or UID, or a part number for all parts of that kind; present ones leave the robot.",
    ),
    Operation(
        "unblock", "Let a blocked part in again.",
        (_part("What was blocked."),),
        Right.ARRANGE, OperationScope.ANYWHERE, EditLog.UNDOABLE, "block", "POST /parts/{part}/unblock",
        "PART is one part, or a part number; unblocked parts come back by themselves.",
    ),
    Operation(
        "ignore", "Hide a part from the arrivals.",
        (_part("A part that is not let in."),),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /parts/{part}/ignore",
    ),
    Operation(
        "set", "Show and set the parameters of a slot.",
        (_slot("The slot."),
         Argument("name", is_needed=True, shown_as="NAME", help="Name of the parameter."),
         Argument("value", ArgumentKind.VALUE, longest=10_000, shown_as="VALUE",
                  help="The new value; without one, what was set by hand is taken back.")),
        Right.SET, OperationScope.ANYWHERE, EditLog.UNDOABLE, "value", "PUT /slots/{slot}/values/{name}",
    ),
    Operation(
        "reset", "Reset to the value of the blueprint or library.",
        (_slot("The slot."), Argument("name", is_needed=True, help="Name of the parameter.")),
        Right.SET, OperationScope.ANYWHERE, EditLog.UNDOABLE, "value", "DELETE /slots/{slot}/values/{name}",
    ),
    Operation(
        "values", "The parameters of a slot with values and origins.",
        (_slot("The slot."),), Right.SEE, OperationScope.ANYWHERE,
    ),
    Operation(
        "bind", "Connect ports by a topic.",
        (_topic(),
         Argument("type", default="", parameter="type_name", option="--type", shown_as="TYPE",
                  help="Message type, such as HelloWorld; of a service both, 'Angle -> Text'; default: the port's."),
         Argument("from", parameter="source", option="--from", shown_as="SLOT.PORT",
                  help="A port that publishes it, or serves."),
         Argument("to", ArgumentKind.TEXTS, default=(), parameter="targets", option="--to", shown_as="SLOT.PORT",
                  help="A port that subscribes to it, or calls; repeatable."),
         Argument("reliable", ArgumentKind.FLAG, default=True, option="--best-effort",
                  help="The newest sample matters more than each sample."),
         Argument("move", ArgumentKind.FLAG, default=False, option="--move",
                  help="First disconnect the subscribing ports from their present topics.")),
        Right.DESIGN, OperationScope.ANYWHERE, EditLog.UNDOABLE, "bind", "POST /topics/{topic}/bind",
        "They are added to those that TOPIC connects already; the parts follow at once.",
    ),
    Operation(
        "unbind", "Disconnect a port from a topic.",
        (_topic(), Argument("port", shown_as="[SLOT.PORT]", help="The port; left out: all of them.")),
        Right.DESIGN, OperationScope.ANYWHERE, EditLog.UNDOABLE, "bind", "POST /topics/{topic}/unbind",
        "Without SLOT.PORT, all its ports; the parts follow at once.",
    ),
    Operation(
        "apply", "Apply a changed blueprint.",
        (Argument("path", is_needed=True, longest=4096, help="The blueprint's file."),
         Argument("folders", ArgumentKind.TEXTS, default=(), longest=4096, help="Folders with more part types.")),
        Right.DESIGN, OperationScope.RUNNING, EditLog.UNDOABLE, "apply",
    ),
    Operation(
        "add_slot", "Give a robot that runs another slot.",
        (_slot("Its name."),
         Argument("part", is_needed=True, help="The part number that it takes."),
         Argument("description", default="", longest=1000, help="What it is for, in words.")),
        Right.DESIGN, OperationScope.RUNNING, EditLog.UNDOABLE, "apply", "POST /slots/{slot}",
    ),
    Operation(
        "remove_slot", "Take a slot out of a robot that runs.",
        (_slot("The slot."),), Right.DESIGN, OperationScope.RUNNING, EditLog.UNDOABLE, "apply", "DELETE /slots/{slot}",
        "Its ends of topics go with it, and a part in it is delisted.",
    ),
    Operation(
        "forget_type", "Take a part type that was adopted out of the library again.",
        (Argument("number", is_needed=True, shown_as="NUMBER", help="Its part number."),),
        Right.DESIGN, OperationScope.RUNNING, EditLog.CHANGE, "library", "DELETE /library/{number}",
        "No slot may take it any more; then a part may describe it anew.",
    ),
    Operation(
        "publish", "Drive a port by hand: the fan, the lamp, the servo.",
        (Argument("port", is_needed=True, shown_as="SLOT.PORT", help="A port that hears something, as fan.power."),
         Argument("values", ArgumentKind.TEXTS, is_needed=True, longest=_LIST, shown_as="VALUE...",
                  help="The values of its message in their order, or FIELD=VALUE."),
         Argument("seconds", ArgumentKind.NUMBER, default=5.0, least=0.1, most=3600.0, option="--seconds",
                  shown_as="SECONDS",
                  help="For how long; default: 5.")),
        Right.OPERATE, OperationScope.RUNNING, EditLog.LINE, "hand", "POST /ports/{port}/publish",
        "Meanwhile messages from its wire are ignored. Afterwards the port gets its safe value, then follows its wire "
        "again.",
    ),
    Operation(
        "let_go", "Stop driving a port by hand.",
        (Argument("port", is_needed=True, shown_as="SLOT.PORT", help="A port that somebody drives by hand."),),
        Right.OPERATE, OperationScope.RUNNING, EditLog.LINE, "hand", "POST /ports/{port}/let_go",
    ),
    Operation(
        "topics", "Every topic: its type, who publishes and who subscribes, how many messages it has carried.",
    ),
    Operation(
        "topic_samples", "The messages of a topic after one of them; waits a while for the next.",
        (_topic(), _topic_type(),
         Argument("after", ArgumentKind.WHOLE, least=0, most=2**53,
                  help="Number of the message after which they are wanted; left out: only the newest number is told."),
         Argument("wait", ArgumentKind.NUMBER, default=0.0, least=0.0, most=3.0,
                  help="Seconds to wait for the next message, if there is none yet."),
         Argument("values", ArgumentKind.FLAG, default=True, help="Also what the messages say.")),
    ),
    Operation(
        "log_lines", "What happened in the robot after a line of its log; waits a while for the next.",
        (Argument("after", ArgumentKind.WHOLE, least=0, most=2**53,
                  help="Number of the line after which they are wanted; left out: the last ones."),
         Argument("last", ArgumentKind.WHOLE, default=10, least=0, most=200, help="How many of the last ones."),
         Argument("wait", ArgumentKind.NUMBER, default=0.0, least=0.0, most=3.0,
                  help="Seconds to wait for the next line, if there is none yet.")),
    ),
    Operation(
        "publish_topic", "Publish one message on a topic, besides what parts publish there.",
        (_topic(),
         Argument("values", ArgumentKind.TEXTS, is_needed=True, longest=_LIST, shown_as="VALUE...",
                  help="The values of the message in their order, or FIELD=VALUE."),
         _topic_type()),
        Right.OPERATE, OperationScope.RUNNING, EditLog.LINE, "hand", "POST /topics/{topic}/publish",
    ),
    Operation(
        "call", "Send a request to a port that serves, and print its reply.",
        (Argument("port", is_needed=True, shown_as="SLOT.PORT", help="A port that serves, as camera.photo."),
         Argument("values", ArgumentKind.TEXTS, is_needed=True, longest=_LIST, shown_as="VALUE...",
                  help="The values of the request in their order, or FIELD=VALUE."),
         Argument("seconds", ArgumentKind.NUMBER, default=2.0, least=0.1, most=60.0, option="--seconds",
                  shown_as="SECONDS",
                  help="How long to wait for the reply; default: 2.")),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /ports/{port}/call",
        "Without a reply, one sentence says why, and the exit status is not 0.",
    ),
    Operation(
        "undo", "Undo a change, or list changes.",
        (Argument("edit", ArgumentKind.WHOLE, least=1, most=2**53, shown_as="[NUMBER]",
                  help="Number of the change; left out: the newest that was not taken back."),),
        Right.SET, OperationScope.ANYWHERE, EditLog.CHANGE, "undo", "POST /undo",
        right_for_others=Right.ARRANGE,
    ),
    Operation(
        "edits", "What was changed lately, and by whom.",
        (Argument("limit", ArgumentKind.WHOLE, default=20, least=1, most=10_000, help="How many changes."),),
        Right.SEE, OperationScope.ANYWHERE,
    ),
    Operation(
        "stop", "STOP: all parts go to their safe states.",
        (Argument("reason", default="", longest=1000, help="Why, for the people who see it."),),
        Right.STOP, OperationScope.RUNNING, EditLog.LINE, "stop", "POST /stop", drops_odd=True, takes_place=True,
    ),
    Operation(
        "go", "End STOP: the parts may work again.",
        (Argument("stop", ArgumentKind.WHOLE, least=1, most=2**53, option="--stop", shown_as="NUMBER",
                  help="The latest STOP that you know of: if another was said since, nothing ends. Left out: any."),),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "go", "POST /go",
    ),
    Operation("stop_report", "Who said STOP, which parts have confirmed it, and which have not."),
    Operation(
        "identify", "Make a part blink or beep, to show which one it is.",
        (_part("The part."),),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /parts/{part}/identify",
        "What it does depends on its program.",
    ),
    Operation(
        "record", "Record what the robot does in a file of its own, in addition to the ring.",
        (Argument("file", is_needed=True, longest=4096, help="The file with its whole path."),
         Argument("ros2", ArgumentKind.FLAG, default=False, option="--ros2",
                  help="As a bag: only what ROS 2 can read, for `ros2 bag`.")),
        Right.ARRANGE,
    ),
    Operation("end_record", "End the recording that `record` began.", (), Right.ARRANGE),
    Operation("recording", "Where the robot is recorded, and what is wrong with that."),
    Operation("objects", "What the parts on CAN buses have set up, for whoever watches a bus from now on."),
    Operation(
        "plant_fault", "Let something go wrong on purpose, for a while.",
        (Argument("kind", is_needed=True, shown_as="KIND", help="Which fault; `msbot fault kinds` lists them."),
         Argument("at", default="", shown_as="[SLOT]", help="The slot, or the part, where it is planted."),
         Argument("amount", ArgumentKind.NUMBER, option="--amount", shown_as="NUMBER",
                  help="How strong it is, in the unit of its kind."),
         Argument("jitter", ArgumentKind.NUMBER, parameter="jitter_ms", least=0.0, most=10_000.0, option="--jitter",
                  shown_as="MS", help="delay: up to so many random milliseconds more."),
         Argument("port", default="", option="--port", shown_as="PORT", help="stuck, drift: only this port."),
         Argument("number", default="", option="--number", shown_as="NUMBER",
                  help="wrong-number: the part number that the wrong part shows."),
         Argument("after", ArgumentKind.NUMBER, parameter="after_s", default=0.0, least=0.0, most=3600.0,
                  option="--after", shown_as="SECONDS", help="It begins after so many seconds."),
         Argument("for", ArgumentKind.NUMBER, parameter="for_s", least=0.1, most=3600.0, option="--for",
                  shown_as="SECONDS", help="How long it lasts; default: 60."),
         Argument("when", default="", option="--when", shown_as="CONDITION",
                  help="It begins when this holds: 'fan is active', 'knob.level > 60', 'load > 40'."),
         Argument("chance", ArgumentKind.NUMBER, least=0.0, most=1.0, option="--chance", shown_as="P",
                  help="It begins in each second with this probability, 0 to 1."),
         Argument("seed", ArgumentKind.WHOLE, least=0, most=2**53, option="--seed", shown_as="N",
                  help="Seed of the random choices."),
         Argument("hidden", ArgumentKind.FLAG, default=False, option="--hidden",
                  help="Do not show it on cards and in `msbot why`.")),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "fault", "POST /faults",
    ),
    Operation(
        "clear_fault", "End a fault that was planted, or all.",
        (Argument("fault", ArgumentKind.WHOLE, least=1, most=2**53, shown_as="[ID]",
                  help="Number of the fault; left out: all."),),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "fault", "POST /faults/clear",
    ),
    Operation(
        "faults", "The faults that are planted, also hidden ones.",
        (Argument("answers", ArgumentKind.FLAG, default=False, option="--answers",
                  help="Also those that a mission wants to be found; its report says who has looked."),),
        Right.ARRANGE,
    ),
    Operation(
        "start_mission", "Begin a mission: faults in the robot that a class finds and repairs.",
        (Argument("mission", is_needed=True, longest=1000, help="A ready mission, or the name of its file."),
         Argument("toml", default="", longest=30_000, help="The text of that file; left out: a ready mission."),
         Argument("seed", ArgumentKind.WHOLE, least=0, most=2**53, help="Seed of the random choices.")),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "mission", "POST /mission/start",
    ),
    Operation(
        "stop_mission", "End the mission that runs.",
        (), Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "mission", "POST /mission/stop",
    ),
    Operation(
        "answer_mission", "Say what is wrong in a mission, and where.",
        (Argument("kind", is_needed=True, help="The kind of fault."),
         Argument("at", default="", help="The slot; left out: the robot as a whole.")),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /mission/answer",
    ),
    Operation(
        "repair", "Have something repaired in a mission.",
        (Argument("repair", is_needed=True, help="What is done; `msbot mission repairs` lists it."),
         Argument("at", default="", help="The slot; left out: the robot as a whole.")),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /mission/repair",
    ),
    Operation(
        "mission_hint", "The next hint of a mission; it costs.",
        (), Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /mission/hint",
    ),
    Operation("mission", "The mission that runs, without its answers."),
    Operation(
        "mission_report", "Marks, times and wrong acts of a mission that is over.",
        (Argument("number", ArgumentKind.WHOLE, least=1, most=2**53, help="Which one; left out: the latest."),),
    ),
    Operation(
        "start_lesson", "Set the robot up for a lesson, and begin it.",
        (Argument("lesson", is_needed=True, shown_as="LESSON", help="Its name; `msbot lesson list` has them."),),
        Right.DESIGN, OperationScope.RUNNING, EditLog.LINE, "lesson", "POST /lesson/start",
    ),
    Operation(
        "stop_lesson", "End the lesson that runs, and put everything back.",
        (), Right.DESIGN, OperationScope.RUNNING, EditLog.LINE, "lesson", "POST /lesson/stop",
    ),
    Operation(
        "join_lesson", "Take part in the lesson that runs: what ticks is kept for you.",
        (), Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /lesson/join",
    ),
    Operation(
        "answer_lesson", "Answer a question of the lesson that runs.",
        (Argument("check", is_needed=True, shown_as="STEP.NUMBER", help="Which question."),
         Argument("answer", is_needed=True, longest=1000, shown_as="ANSWER", help="The answer.")),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /lesson/answer",
    ),
    Operation(
        "hand", "Ask the teacher for help, in a lesson or not.",
        (Argument("down", ArgumentKind.FLAG, default=False, option="--down", help="No help is needed any more."),),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /lesson/hand",
    ),
    Operation(
        "who_stops", "Whose programs and parts stop when a lesson begins, because the robot gets its slots.",
        (Argument("lesson", is_needed=True, shown_as="LESSON", help="Its name."),),
    ),
    Operation("lesson", "The lesson that runs, what has ticked, and a hint for who is stuck."),
    Operation(
        "pause_world", "Stop the time of the world that simulated robots drive in.",
        (Argument("off", ArgumentKind.FLAG, default=False, option="--off", help="Continue."),),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /world/pause",
    ),
    Operation(
        "step_world", "Let some steps pass in the world, a fiftieth of a second each; it stands still afterwards.",
        (Argument("steps", ArgumentKind.WHOLE, default=1, least=1, most=500, option="--steps", help="How many."),),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /world/step",
    ),
    Operation(
        "reset_world", "Put everything in the world back to where it was at the start.",
        (), Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /world/reset",
    ),
    Operation(
        "world_speed", "Say how many seconds pass in the world in one second.",
        (Argument("speed", ArgumentKind.NUMBER, is_needed=True, least=0.25, most=4.0, shown_as="SPEED",
                  help="0.25, 0.5, 1, 2 or 4."),),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /world/speed",
    ),
    Operation(
        "put_robot", "Put a robot of the world elsewhere.",
        (Argument("robot", is_needed=True, shown_as="ROBOT", help="Its name in the world."),
         Argument("x", ArgumentKind.NUMBER, is_needed=True, shown_as="X", help="Metres from the left."),
         Argument("y", ArgumentKind.NUMBER, is_needed=True, shown_as="Y", help="Metres from below."),
         Argument("heading", ArgumentKind.NUMBER, option="--heading",
                  help="Degrees from east, counter-clockwise; left out: as it looks now.")),
        Right.OPERATE, OperationScope.RUNNING, EditLog.NOTHING, "", "POST /world/put",
    ),
    Operation("world", "The world that simulated robots drive in: its time, and where everything is."),
    Operation(
        "freeze", "Hold the programs of all pupils: what they drive goes to its safe value.",
        (Argument("reason", default="", longest=1000, shown_as="[REASON]", help="Why, for the pupils' pages."),),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "class", "POST /class/freeze",
        "Programs that begin later are held, too; those of teachers are not. STOP is something else.",
    ),
    Operation(
        "thaw", "Let the pupils' programs go on.",
        (), Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "class", "POST /class/thaw",
    ),
    Operation(
        "take_over", "Take the program of a pupil: it is held until it is handed back.",
        (_pupil(),
         Argument("run", ArgumentKind.FLAG, default=False, option="--run",
                  help="Run it for the teacher instead of holding it.")),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "class", "POST /class/pupils/{pupil}/take_over",
    ),
    Operation(
        "hand_back", "Give a pupil the program back.",
        (_pupil(),), Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "class",
        "POST /class/pupils/{pupil}/hand_back",
    ),
    Operation(
        "group", "Make a group of pupils with slots of its own, or change it.",
        (_group(),
         Argument("pupils", ArgumentKind.TEXTS, default=(), option="--pupil", shown_as="NAME",
                  help="A pupil of the group; may be given several times."),
         Argument("slots", ArgumentKind.TEXTS, default=(), option="--slot", shown_as="SLOT",
                  help="A slot that only this group may use; may be given several times.")),
        Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "class", "PUT /class/groups/{group}",
        "Pupils and slots leave the groups that they were in.",
    ),
    Operation(
        "remove_group", "Take a group away: its slots are everybody's.",
        (_group(),), Right.ARRANGE, OperationScope.RUNNING, EditLog.LINE, "class", "DELETE /class/groups/{group}",
    ),
    Operation("classroom", "Groups, pupils, whose programs are held and why, whose hand is up.", (), Right.ARRANGE),
    Operation("stored", "Wait until what the robot has said is in its database, as far as that is possible."),
    Operation("versions", "Where the parts in the slots run, and the versions that they say."),
    Operation("why", "The state of a part, and which rules led there.", (_part("The part."),)),
)  # fmt: skip

OPERATIONS: Mapping[str, Operation] = MappingProxyType({row.name: row for row in _ROWS})
"""Every operation by its name, in the order of the reference."""
