"""What a part in the browser says in English, for the page Program: in the person's language, and with hints.

The part is MicroPython's, and has no room for languages; the page puts its sentences into one, by their forms.
"""

from __future__ import annotations

from collections.abc import Callable

from msbot.part.join.refusal import Refusal

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
    "{error} (said once, counted from now on)",
    "there is no port {port} to publish on; {bound}",
    "bound in this robot: {ports}",
    "this robot binds no port of the part",
    "port {port} carries {type}, not {other}",
    "the part is {state}, not active ({reason}): publish after on_join",
    "there is no setting {name} in this robot; it sets: {known}",
    "{field} cannot be {value}: {needs}",
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
    known = {form: say(form) for form in (*PART_SAYS, *(one.words for one in Refusal))}
    return {form: f"{form} – {hint}" for form, hint in hints.items()} | known
