"""Whether what a program publishes is in the range that the library declares, as `msbot.part.range_watch`.

Imported when a configuration has a range. A value outside is sent as it is, counted, and said once for each field.
"""


def watch(part, settings):
    """Look at what the part publishes from now on; in `settings` are `PORT.range.FIELD`, each `least most`."""
    table = {}
    for name, text in settings:
        port, mark, field = name.partition(".range.")
        if not mark:
            continue
        try:
            least, most = [float(one) for one in text.split()]
        except ValueError:
            continue  # of a master that says it in another way
        table.setdefault(port, []).append((field, least, most))

    if "ranges" in part.__dict__:
        part.ranges = table
        return
    part.ranges = table
    before = part.publish  # a browser has put itself in front of it, too

    def publish(port, message):
        sent = before(port, message)
        if port in part.ranges:
            _look(part, port, message, part.ranges[port])
        return sent

    part.publish = publish


def _look(part, port, message, ranges):
    is_outside = False
    for field, least, most in ranges:
        value = _outside(message, field, least, most)
        if value is None:
            continue
        is_outside = True
        if (port, field) not in part._reported:
            part._reported.add((port, field))
            words = "{}: {} is published as {:g}; the robot's library says {:g} to {:g}"
            part.log(words.format(port, field, value, least, most), "warning")
    part.out_of_range += is_outside


def _outside(message, way, least, most):
    """The value of a field (`pose.x`), or the first of a list, that is out of range; None: there is none."""
    found = message
    for name in way.split("."):
        found = getattr(found, name, None)
    for one in found if isinstance(found, list) else [found]:
        if isinstance(one, (int, float)) and not isinstance(one, bool) and not least <= one <= most:
            return one
    return None
