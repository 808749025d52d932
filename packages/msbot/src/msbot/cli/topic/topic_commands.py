"""`msbot topic`: list topics, see their messages and rates as they come, publish one by hand."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import click

from msbot.cli import completers
from msbot.cli.change.robot_access import MasterConnection
from msbot.cli.message_input import is_message, typed_values
from msbot.cli.robot_options import robot_options
from msbot.cli.topic.message_output import MessageOutput, TimeForm
from msbot.cli.topic.rates import MessageWindow
from msbot.service_types import service_type
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import FiniteRange, WholeRange, json_option
from msbot_agent.cli.table import print_table
from msbot_agent.text.sentence import printable
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError

WAIT_S = 2.0
"""How long the master waits for the next message before it answers that there is none."""
PAUSE_S = 0.05
"""Least time between two requests: a topic with a thousand messages a second needs no thousand requests."""
REPORT_S = 1.0
WINDOW = 10_000


@click.group("topic")
def command() -> None:
    """Look at the topics of a running robot, and publish on them, as `ros2 topic` does."""


class RobotTopics(MasterConnection):
    """The running master, asked about topics."""

    def topics(self) -> list[dict[str, Any]]:
        """Every topic of the robot."""
        found: list[dict[str, Any]] = self.ask("topics")["topics"]
        return found

    def topic(self, name: str) -> dict[str, Any]:
        """The topic of that name.

        Raises:
            ConfigError: there is none; the text names those that are like it.
        """
        known = {one["topic"]: one for one in self.topics()}
        for word in (name, name.lstrip("/")):
            if word in known:
                return known[word]
        near = nearest(name.lstrip("/"), known)
        hint = did_you_mean(near) if near else "`msbot topic list` lists them"
        raise ConfigError(f"this robot has no topic {name!r}; {hint}")


def _check_is_topic(meant: Mapping[str, Any]) -> None:
    """Refuse a service, whose requests and replies no topic shows.

    Raises:
        ConfigError: it is one; the text says what calls it.
    """
    if meant["service"]:
        port = _ends(meant["publishers"])
        how = f"`msbot call {port} VALUE...` calls it" if meant["publishers"] else "a node of ROS 2 serves it"
        raise ConfigError(f"{meant['topic']} is a service, and no topic: {how}")


def _say_if_empty(meant: Mapping[str, Any]) -> None:
    """Say why nothing may come: the slots that publish have no part."""
    empty = [end["slot"] for end in meant["publishers"] if not end["part"]]
    if empty and len(empty) == len(meant["publishers"]):
        slots = f"slot {empty[0]} is" if len(empty) == 1 else f"slots {', '.join(empty)} are"
        click.echo(f"msbot: {slots} empty: no part publishes on {meant['topic']} now", err=True)


def _type_given(topic: str, type_name: str | None, meant: Mapping[str, Any]) -> str | None:
    if meant["free"] and not type_name:
        raise ConfigError(f"{topic} is a free topic, of any type: name its type behind it, as HelloWorld")
    return type_name


def _answers(
    asked: RobotTopics, topic: str, type_name: str | None, *, wait: float, values: bool
) -> Iterator[dict[str, Any]]:
    """What the master answers about a topic, again and again: `samples`, `missed`."""
    after = int(asked.ask("topic_samples", topic=topic, type=type_name)["next"])
    while True:
        began = time.monotonic()
        answer = asked.ask("topic_samples", topic=topic, type=type_name, after=after, wait=wait, values=values)
        after = int(answer["next"])
        yield answer
        time.sleep(max(0.0, began + PAUSE_S - time.monotonic()))


_topic_argument = click.argument("topic", shell_complete=completers.topics)
_type_argument = click.argument("type_name", required=False, metavar="[TYPE]")


# What there is


@command.command("list")
@click.option("-t", "--show-types", is_flag=True, help="Also show the type of each.")
@click.option("-c", "--count-topics", is_flag=True, help="Only say how many there are.")
@click.option("-v", "--verbose", is_flag=True, help="Also show types, ports and messages so far.")
@json_option
@robot_options
def list_(
    db: str | None, robot: str | None, *, show_types: bool, count_topics: bool, verbose: bool, as_json: bool
) -> None:
    """List the topics of the robot."""
    topics = RobotTopics(db, robot).topics()
    if as_json:
        click.echo(json.dumps(topics))
    elif count_topics:
        click.echo(str(len(topics)))
    elif verbose:
        print_table(("topic", "type", "messages", "publishers", "subscribers"), [_row(one) for one in topics])
    else:
        for one in topics:
            name = printable(one["topic"])
            kind = f" [{one['type'] or 'free'}]" if show_types else " (service)" if one["service"] else ""
            click.echo(f"{name}{kind}")


def _row(topic: Mapping[str, Any]) -> tuple[str, ...]:
    ends = _ends(topic["publishers"]), _ends(topic["subscribers"])
    return topic["topic"], topic["type"] or "free", str(topic["published"]), *ends


def _ends(ends: list[dict[str, str]]) -> str:
    return ", ".join(f"{end['slot']}.{end['port']}" for end in ends) or "nobody"


@command.command("info")
@_topic_argument
@click.option("-v", "--verbose", is_flag=True, help="Also name the parts in the slots.")
@json_option
@robot_options
def info(topic: str, db: str | None, robot: str | None, *, verbose: bool, as_json: bool) -> None:
    """Show a topic: its type and fields, who publishes and who subscribes."""
    found = RobotTopics(db, robot).topic(topic)
    if as_json:
        click.echo(json.dumps(found))
        return
    click.echo(f"Type: {found['type'] or 'any (a free topic)'}")
    for line in _type_lines(found):
        click.echo(line)
    titles = ("Server", "Client") if found["service"] else ("Publisher", "Subscription")
    if not found["service"]:  # requests and replies are always reliable
        click.echo(f"Reliability: {'reliable' if found['reliable'] else 'best effort'}")
    for title, key in zip(titles, ("publishers", "subscribers"), strict=True):
        click.echo(f"{title} count: {len(found[key])}")
        for end in found[key]:
            part = f"  ({end['part']})" if verbose and end["part"] else ""
            part = part or ("" if end["part"] else f"  (slot {end['slot']} is empty)")
            click.echo(f"  {end['slot']}.{end['port']}{part}")
    if found["service"]:  # people's requests are not published by a part
        click.echo(f"Requests so far: {found['delivered']} delivered")
    else:
        click.echo(f"Messages so far: {found['published']} published, {found['delivered']} delivered")


def _type_lines(topic: Mapping[str, Any]) -> Iterator[str]:
    """The fields of a message, those of types inside below theirs; of a service those of request and reply."""
    ends = service_type(topic["type"])
    if ends is None:
        yield from _field_lines(topic, topic["type"], 1)
        return
    for title, name in (("Request", ends.request), ("Reply", ends.reply)):
        yield f"{title}: {name}"
        yield from _field_lines(topic, name, 1)


def _field_lines(topic: Mapping[str, Any], type_name: str, depth: int) -> Iterator[str]:
    units = topic["type_units"].get(type_name, {})
    for name, kind in topic["types"].get(type_name, ()):
        yield f"{'  ' * depth}{name}: {kind} {units.get(name, '')}".rstrip()
        yield from _field_lines(topic, kind.partition("[")[0], depth + 1)


# Messages as they come


@command.command("echo")
@_topic_argument
@_type_argument
@click.option("--once", is_flag=True, help="Print one message, then end.")
@click.option("-n", "--count", type=WholeRange(1), metavar="N", help="Print so many messages, then end.")
@click.option("--field", default="", metavar="FIELD", help="Only this field; pose.x for one in a nested message.")
@click.option("--csv", "as_csv", is_flag=True, help="A line for each message: its values, with commas.")
@click.option("--json", "as_json", is_flag=True, help="A line for each message: a JSON object.")
@click.option(
    "-t",
    "times",
    type=click.Choice([form.value for form in TimeForm]),
    help="A line for each message with its time: (a)bsolute, (d)elta, (z)ero, (A)bsolute with date.",
)
@click.option(
    "--timeout",
    type=FiniteRange(min=0.1),
    metavar="SECONDS",
    help="End with status 1 when no message comes for so long.",
)
@robot_options
def echo(
    topic: str,
    type_name: str | None,
    *,
    once: bool,
    count: int | None,
    field: str,
    as_csv: bool,
    as_json: bool,
    times: str | None,
    timeout: float | None,
    db: str | None,
    robot: str | None,
) -> None:
    """Print the messages of a topic as they come, until Ctrl-C."""
    if sum((as_csv, as_json, times is not None)) > 1:
        raise click.UsageError("choose one of --csv, --json and -t")
    asked = RobotTopics(db, robot)
    meant = asked.topic(topic)
    _type_given(topic, type_name, meant)
    _check_is_topic(meant)
    _say_if_empty(meant)
    form = None if times is None else TimeForm(times)
    output = MessageOutput(meant["topic"], field=field, as_csv=as_csv, as_json=as_json, times=form)
    most = 1 if once else count
    wait = min(WAIT_S, WAIT_S if timeout is None else timeout)
    shown = missed = 0
    heard_at = time.monotonic()
    try:
        for answer in _answers(asked, meant["topic"], type_name, wait=wait, values=True):
            if answer["missed"]:
                missed += int(answer["missed"])
                click.echo(f"msbot: {amount(int(answer['missed']), 'message')} missed: read more quickly", err=True)
            for sample in answer["samples"]:
                heard_at = time.monotonic()
                for line in output.lines(sample):
                    click.echo(line)
                shown += 1
                if shown == most:
                    return
            if timeout is not None and time.monotonic() - heard_at >= timeout:
                click.echo(f"msbot: no message on {meant['topic']} for {timeout:g} s", err=True)
                sys.exit(ExitStatus.NO)
    except KeyboardInterrupt:
        lost = f", {missed} missed" if missed else ""
        click.echo(f"\n{meant['topic']}: {amount(shown, 'message')}{lost}", err=True)


# Rates


def _rate_options(function: Callable[..., None]) -> Callable[..., None]:
    for option in (
        click.option("-n", "--count", type=WholeRange(1), metavar="N", help="End after so many reports."),
        click.option(
            "-w",
            "--window",
            type=WholeRange(2, 100_000),
            default=WINDOW,
            show_default=True,
            metavar="N",
            help="Count the newest N messages.",
        ),
        click.option("--json", "as_json", is_flag=True, help="A JSON object for each report."),
    ):
        function = option(function)
    return function


@command.command("hz")
@_topic_argument
@_type_argument
@_rate_options
@robot_options
def hz(
    topic: str,
    type_name: str | None,
    *,
    count: int | None,
    window: int,
    as_json: bool,
    db: str | None,
    robot: str | None,
) -> None:
    """Print each second how many messages a second come, until Ctrl-C."""

    def report(seen: MessageWindow, _now: float) -> str | None:
        rate = seen.rate
        return None if rate is None else json.dumps(rate.as_json()) if as_json else rate.describe

    _reports(RobotTopics(db, robot), topic, type_name, report, window=window, count=count)


@command.command("bw")
@_topic_argument
@_type_argument
@_rate_options
@robot_options
def bw(
    topic: str,
    type_name: str | None,
    *,
    count: int | None,
    window: int,
    as_json: bool,
    db: str | None,
    robot: str | None,
) -> None:
    """Print each second how many bytes a second the messages take, until Ctrl-C."""

    def report(seen: MessageWindow, now: float) -> str | None:
        found = seen.bandwidth(now)
        return None if found is None else json.dumps(found.as_json()) if as_json else found.describe

    _reports(RobotTopics(db, robot), topic, type_name, report, window=window, count=count)


def _reports(
    asked: RobotTopics,
    topic: str,
    type_name: str | None,
    report: Callable[[MessageWindow, float], str | None],
    *,
    window: int,
    count: int | None,
) -> None:
    meant = asked.topic(topic)
    _type_given(topic, type_name, meant)
    _check_is_topic(meant)
    _say_if_empty(meant)
    seen, messages, reported = MessageWindow(window), 0, 0
    next_at = time.monotonic() + REPORT_S
    try:
        for answer in _answers(asked, meant["topic"], type_name, wait=REPORT_S, values=False):
            for sample in answer["samples"]:
                seen.add(float(sample["at"]), int(sample["octets"]))
            messages += len(answer["samples"]) + int(answer["missed"])
            if time.monotonic() < next_at:
                continue
            next_at = time.monotonic() + REPORT_S
            words = report(seen, time.time())
            if words is None:
                click.echo("no new messages", err=True)
                continue
            click.echo(words)
            reported += 1
            if reported == count:
                return
    except KeyboardInterrupt:
        click.echo(f"\n{meant['topic']}: {amount(messages, 'message')}", err=True)


# A message by hand


@command.command("pub", context_settings={"ignore_unknown_options": True})
@_topic_argument
@click.argument("values", nargs=-1, required=True, metavar="[TYPE] VALUE...")
@click.option("--once", is_flag=True, help="Publish one message, as without --rate.")
@click.option("-r", "--rate", type=FiniteRange(min=0.01, max=50), metavar="HZ", help="Messages a second.")
@click.option("-t", "--times", type=WholeRange(1), metavar="N", help="End after so many messages; 1 a second.")
@json_option
@robot_options
def pub(
    topic: str,
    values: tuple[str, ...],
    *,
    once: bool,
    rate: float | None,
    times: int | None,
    as_json: bool,
    db: str | None,
    robot: str | None,
) -> None:
    """Publish a message on a topic, in addition to what parts publish there.

    VALUE: the values of the message in their order, FIELD=VALUE, or one text '{field: value, ...}'. With --rate,
    repeats until Ctrl-C.
    """
    if once and (rate is not None or times is not None):
        raise click.UsageError("--once is one message: leave --rate and --times out")
    if topic == "-1" and len(values) > 1:  # that is how ros2 writes --once; in front of values it is a number
        topic, values = values[0], values[1:]
    asked = RobotTopics(db, robot)
    meant = asked.topic(topic)
    _check_is_topic(meant)
    type_name, wanted = _type_and_values(meant, values)
    _type_given(topic, type_name, meant)
    most = times if rate is not None or times is not None else 1
    done = 0
    try:
        next_at = time.monotonic()
        while most is None or done < most:
            answer = asked.ask("publish_topic", topic=meant["topic"], values=wanted, type=type_name)
            done += 1
            if done == 1:
                click.echo(json.dumps(answer) if as_json else answer["words"])
            next_at += 1 / (rate or 1.0)
            if done != most:
                time.sleep(max(0.0, next_at - time.monotonic()))
    except KeyboardInterrupt:
        click.echo(f"\n{meant['topic']}: {amount(done, 'message')} published", err=True)


def _takes_a_text(meant: Mapping[str, Any]) -> bool:
    return len(meant["fields"]) == 1 and str(meant["fields"][0][1]).startswith("string")


def _type_and_values(meant: Mapping[str, Any], words: tuple[str, ...]) -> tuple[str | None, list[str]]:
    """The type, if it was written, and the values."""
    first, *others = words
    type_name = None
    of_this_type = first.rpartition("/")[2] == meant["type"]
    if of_this_type and not others and not _takes_a_text(meant):
        fields = ", ".join(f"{name} ({kind})" for name, kind in meant["fields"])
        raise ConfigError(f"{meant['topic']}: the values are missing behind {first}: {fields}")
    if others and (meant["free"] or of_this_type or (len(words) == 2 and is_message(words[1]))):
        type_name, words = first.rpartition("/")[2], tuple(others)
    return type_name, typed_values(words, [name for name, _ in meant["fields"]])
