"""What the script of the page Program says."""

from __future__ import annotations

from collections.abc import Callable

from msbot.part import JoinState
from msbot.part.join.refusal import STANDBY, Refusal

# What a part in the browser says in English, for the page Program: in the person's language, and with hints.
#
# The part is MicroPython's, and has no room for languages; the page puts its sentences into one, by their forms.


PART_SAYS = (
    "{part} is {state}: {reason}",
    "{part} has ended",
    "the program has come to its end; it runs no part",
    "the program has ended itself",
    "agent found, waiting for the robot's profile",
    "recognised robot {robot}",
    "registered, fetching the configuration",
    "in slot {slot}",
    "the inventory does not know this part any more",
    "the connection with the robot's page has ended",
    "no agent answers on {link}",
    "this robot's {word} is {theirs}, the part expects {mine}",
    "GO: STOP is over",
    "STOP: {reason}",
    "said by the master",
    "{part}: somebody asks which part this is",
    "{part}: nobody sends to port {port} any more",
    "{part}: nobody serves what port {port} calls any more",
    "{error} (said once, counted from now on)",
    "there is no port {port} to publish on; {bound}",
    "bound in this robot: {ports}",
    "this robot binds no port of the part",
    "port {port}: nobody can call it before {command}; {bound}",
    '{reason}; with Part(..., describes="what it is") somebody can adopt it',
    "the robot does not know this part number, and is told what the part is: it waits until somebody adopts it, on the "
    "page Arrivals or with `msbot adopt`",
    "the robot says: {words}",
    "port {port} carries {type}, not {other}",
    "the part is {state}, not active ({reason}): publish after on_join",
    "the part is {state}, not active ({reason}): call after on_join",
    "part.call({port}, ...) cannot wait for the reply on boards and in browsers: give it on_reply=..., a function of two "
    "arguments, reply and error",
    "part.call({port}, ...): say at the top of the program what goes and what comes: part.calls({calls}, Request, Reply)",
    "port {port} sends {class}(...), not {given}",
    "returned {value}: below @part.serves({port}, ...) return {reply}(...)",
    "there is no setting {name} in this robot; it sets: {known}",
    "{field} cannot be {value}: {needs}",
    "{field} must have at most {most} elements; it has {size}",
    "{field} must have exactly {most} elements; it has {size}",
    "{type} needs a number",
    "{type} needs a whole number from {low} to {high}",
    "bool needs True or False",
    "{message} has no field {field}",
    "nobody can answer input() here: the values come from ports and settings",
)
"""Forms of sentences of `micropython`; what is not among them shows as it is."""


def part_sentences(say: Callable[[str], str]) -> dict[str, str]:
    """Forms in English, more exact ones first -> what the page shows for them; Python's errors keep their words."""
    hints = {
        "invalid syntax": say("Is a bracket, a quote or a colon missing, in this line or the one before?"),
        "unexpected indent": say("Does this line begin further to the right than it should?"),
        "unindent doesn't match any outer indent level": say("Does this line begin below one of those above it?"),
        "name {name} isn't defined": say("Is it spelt right, and does it get its value before this line?"),
        "local variable referenced before assignment": say("Does the function need a line `global` with this name?"),
        "no module named {name}": say("Programs in the browser do not have it."),
        "module {module} has no attribute {name}": say("Is it spelt right?"),
        "{type} object has no attribute {name}": say("Is it spelt right?"),
        "unsupported types for {operation}: {one}, {other}": say("Are both of the same kind, numbers or texts?"),
        "can't convert {one} object to {other} implicitly": say("Are both of the same kind, numbers or texts?"),
        "function takes {count} positional arguments but {given} were given": say(
            "Does the call give the function as many values as it has names in its brackets?"
        ),
        "divide by zero": say("Nothing can be divided by 0: ask first, with `if`."),
    }
    known = {form: say(form) for form in (*PART_SAYS, *(one.describe for one in Refusal))}
    return {form: f"{form} – {hint}" for form, hint in hints.items()} | known


def program_words(say: Callable[[str], str]) -> dict[str, object]:
    """What the script says, in the person's language; the states as the part calls them."""
    titles = {
        JoinState.LOOKING: say("looking for the robot"),
        JoinState.RECOGNISING: say("recognising the robot"),
        JoinState.CLAIMING: say("registering"),
        JoinState.CONFIGURING: say("being configured"),
        JoinState.ACTIVE: say("active"),
        JoinState.REFUSED: say("refused"),
        JoinState.LOST: say("lost"),
        JoinState.WRONG_ROBOT: say("wrong robot"),
        JoinState.ENDED: say("ended"),
    }
    states = {state.value: words for state, words in titles.items()}
    states |= {STANDBY: say(STANDBY)}
    states |= {"not running": say("not running"), "starting": say("starting"), "busy": say("busy")}
    return {
        "states": states,
        "said": part_sentences(say),
        "reloaded": say("{name} ended when this page was left or loaded anew: press Run, and it runs again."),
        "no_slot": Refusal.NO_SLOT.describe,
        "slot": say("In slot {slot}"),
        "unwired": say("not wired in this robot"),
        "stopped": say("STOP holds: messages do not reach the program"),
        "adopt": say("Under Arrivals a teacher can let {number} in."),
        "waits": say("It waits until the part in such a slot ends, or a teacher gives it a slot under Arrivals."),
        "describes": say("It tells the robot what it is: a teacher can adopt it."),
        "line": say("line {number}"),
        "block": say("the block"),
        "left": say("… left out, too many lines at once: {number}"),
        "tooFast": say("Messages not sent: {number}. The program sends more than the robot takes: send less often."),
        "stuck": say(
            "A function of the program does not end: the part cannot beat meanwhile. Press Stop, and end the loop in it."
        ),
        "stuckFor": say("For {seconds} s in one function."),
        "killed": say("The program did not answer and was ended."),
        "noFiles": say("The robot's computer does not answer: the program cannot start."),
        "tilt": say("Tilt:"),
        "noTilt": say("No tilt from this device (yet)."),
        "boardNoPort": say("No port was chosen."),
        "boardAsks": say("Asking the board …"),
        "boardWrites": say("{done} of {all} kB are written"),
        "boardRuns": say(
            "{name} runs on the board now, and whenever it starts; {count} files were written. The console shows what "
            "it says."
        ),
        "board_busy": say("The port cannot be opened: does another program use it? ({detail})"),
        "board_silent": say(
            "The board does not answer, not even to Ctrl-C: press its RESET button and try again, or put MicroPython "
            "on it."
        ),
        "board_garbage": say("What is at this port does not answer as MicroPython does: {detail}"),
        "board_unplugged": say("The board was unplugged. Plug it in and write again: it goes on from there."),
        "board_other": say("The board runs {detail}: it needs MicroPython 1.22 or newer."),
        "board_old": say("The board has MicroPython {detail}: it needs 1.22 or newer."),
        "board_noSpace": say("The board has no space: {detail} kB more are needed. Nothing was written."),
        "board_full": say("The board has no space left: {detail}"),
        "board_failed": say("The board says: {detail}"),
        "board_noWay": say("The board does not know its way to the master yet: write it into the field above."),
        "board_noFiles": say("The robot's computer does not answer: nothing was written."),
        "tiltNeedsTls": say("Browsers tell the tilt only on pages with https: start the robot with --certificate."),
    }
