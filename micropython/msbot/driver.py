"""What a driver on a generic board is: a class that reads or switches one real thing, and knows nothing of robots."""

from .errors import MsbotError


class Fault(MsbotError):
    """A chip or pin does not answer; the text says what to check."""


class Driver:
    """Base of all drivers. One that reads has `sample`, one that switches `outputs_for` and `drive`.

    They raise Fault or OSError; the driver is then closed, and opened again until it works.
    """

    samples = drives = False
    poll = 0  # ms between two readings for ports that speak on a change

    def __init__(self, document):
        self.number = document["number"]
        self.pins = document.get("pins", {})
        self.options = document.get("options", {})
        self.sources = document["sources"]
        self.kept = []

    def keep(self, thing):
        """Close that thing with the driver."""
        self.kept.append(thing)
        return thing

    def open(self):
        """Take the pins; outputs are off."""

    def close(self):
        """Switch outputs off and free the pins; may be called at any time."""
        kept, self.kept = self.kept, []
        for thing in kept[::-1]:
            thing.close()

    def sample(self, values):
        """What was measured, by source; a list of such tables in the order of events; None: nothing new."""

    def outputs_for(self, values):
        """What the outputs should be."""

    def drive(self, wanted):
        """Set them."""

    def words(self, error):
        """What an error of the hardware means, and what to check."""
        if isinstance(error, Fault):
            return str(error)
        wires = ", ".join(["{} at pin {}".format(name, pin) for name, pin in self.pins.items()])
        return "{} ({}) cannot be used: {}".format(self.number, wires, error)
