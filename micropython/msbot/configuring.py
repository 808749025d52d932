"""How a part takes a configuration: settings, safe values, ports. Imported for each one, and forgotten again."""

from .cdr import Reader
from .errors import ConfigError, LocalProtocolError
from .message import type_name_of
from .objects import PARTICIPANT, PUBLISHER, SUBSCRIBER, endpoint_blob, service_blob, topic_blob
from .part import Timed, read_setting, stream_of
from .running import forget, load, once

forget("objects")


def read(octets):
    """What is in a configuration of the inventory: version, slot, bindings, settings. One without a slot says why."""
    reader = Reader(octets)
    version, slot = reader.number("I"), reader.text()
    bindings = []
    for _ in range(reader.number("I")):
        port, topic, topic_type = reader.text(), reader.text(), reader.text()
        direction, reliable = reader.take(2)  # 0 publishes, 1 subscribes, 2 serves, 3 calls
        bindings.append((port, topic, topic_type, direction, reliable == 1))
    settings = [(reader.text(), reader.text()) for _ in range(reader.number("I"))]
    if not slot:  # of a part that is not let in
        once("words").tell_help(settings)
    return version, slot, bindings, settings


def configure(part, slot, bindings, settings, now):
    """See `Part.configure`."""
    part.slot = slot
    safe = {}
    stop = None
    watched = "ranges" in part.__dict__  # those of an earlier configuration
    part.settings = {}
    for name, text in settings:
        port, mark, field = name.partition(".safe.")
        if mark:
            safe.setdefault(port, {})[field] = text
        elif ".range." in name:
            watched = True
        elif name == ".stop":
            stop = text
        else:
            part.settings[name] = text
    if watched:
        load("range_watch").watch(part, settings)
    part._safe = {}
    for port, fields in safe.items():
        if port in part._listeners:
            _make_safe(part, port, fields)
    if stop is None:
        part.no_stop_holds()
    elif stop.isdigit():
        part.stop_said("it holds in the robot that the part has joined", now, int(stop))
    bind(part, bindings)
    for port, (message_class, _, optional) in part._listeners.items():
        bound = part._ports.get(port)
        name = type_name_of(message_class)
        if not bound:
            if not optional:
                part.report("port {!r}".format(port), "nothing will come in; " + part._bound_words())
        elif bound[0][2] != name:
            words = "carries {}, but its function expects {}".format(bound[0][2], name)
            part.report("port {!r}".format(port), words)
    if part.services:
        part.services.check()
    once("type_hash").tell(part)
    _tell_settings(part, now)


def bind(part, bindings):
    """Have objects at the agent for these ports, and for no others."""
    client = part._client
    part._places = [binding[0] for binding in bindings]
    wanted = {binding[0]: binding for binding in bindings}
    for port, (binding, topic_id, object_id) in list(part._ports.items()):
        if wanted.get(port) != binding:
            del part._ports[port]
            client.delete(object_id)
            if topic_id:
                client.delete(topic_id)
    for binding in bindings:
        port, topic, topic_type, direction, reliable = binding
        if port in part._ports or direction > 3:
            continue
        request, arrow, reply = topic_type.partition(" -> ")
        if direction > 1:
            if arrow:
                part.use_services()
                object_id = client.free_id(10 - direction)
                client.create(object_id, service_blob(topic, request, reply), PARTICIPANT)
                client.read(object_id)
                part._ports[port] = (binding, 0, object_id)
            continue
        topic_id = client.free_id(2)
        client.create(topic_id, topic_blob(topic, topic_type), PARTICIPANT)
        if direction:
            object_id = client.free_id(6)
            client.create(object_id, endpoint_blob(topic_id, reliable, b"\0\0"), SUBSCRIBER)
        else:
            if not client.find(PUBLISHER):
                client.create(PUBLISHER, b"\0\0", PARTICIPANT)
            object_id = client.free_id(5)
            client.create(object_id, endpoint_blob(topic_id, reliable, b"\0"), PUBLISHER)
        part._ports[port] = (binding, topic_id, object_id)
        if direction:
            client.read(object_id, stream_of(binding))
    if not bindings and client.find(PUBLISHER):
        client.delete(PUBLISHER)


def _tell_settings(part, now):
    told, part._told = part._told, {}
    for name, kind, function in part._followers:
        text = part._told[name] = part.settings.get(name, part._defaults.get(name))
        if text is None:
            part.report("setting {!r}".format(name), "this robot does not set it", "absent")
        elif told.get(name) != text:
            try:
                value = read_setting(name, text, kind)
            except ConfigError as error:
                part.report("setting {!r}".format(name), str(error))
            else:
                if isinstance(function, Timed):
                    _pace(part, function, name, value, now)
                else:
                    part._call(function, value)


def _pace(part, timed, name, seconds, now):
    if not 0.001 <= seconds < 1e9:
        words = "{} s is not a period; {} s stays".format(seconds, timed.period / 1000)
        part.report("setting {!r}".format(name), words)
    elif int(seconds * 1000 + 0.5) != timed.period:
        timed.period = int(seconds * 1000 + 0.5)
        if timed.due_at is not None:
            timed.due_at = now


def _make_safe(part, port, fields):
    try:
        message = part._listeners[port][0]()
        for name, text in fields.items():
            once("leaves").set_leaf(message, name, text)
        message._check()
        part._safe[port] = message
    except (ConfigError, LocalProtocolError, ValueError, KeyError) as error:
        part.report("safe value of port {!r}".format(port), "cannot be used: {}".format(error))
