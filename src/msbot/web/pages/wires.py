"""The wires page: who publishes what to whom, drawn as a graph with rates, and listed as a table."""

from __future__ import annotations

from html import escape

from fastapi import Request
from nicegui import ui

from msbot.web.drawings import value_words
from msbot.web.graph import wiring_svg
from msbot.web.pages.layout import Page, page_frame
from msbot.web.service import Service


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/wires")
    def wires(request: Request) -> None:
        with page_frame(service, request, "/wires", "Wires") as page:
            _graph(page)


def _graph(page: Page) -> None:
    with ui.element("div").classes("panel"):
        with ui.element("div").classes("row spread"):
            ui.label(page.say("Green: samples are flowing. Dashed: silence. Click a slot to open it.")).classes("soft")
            save = ui.button(page.say("Picture (SVG)"), icon="image").props("flat")
        drawing = ui.html("", sanitize=False).classes("w-full scroll")
        save.on_click(lambda: ui.download.content(drawing.content, "wires.svg"))
    table = ui.html("", sanitize=False).classes("panel scroll")

    def show() -> None:
        views = page.service.views
        topics = views.topics()
        states = {card.name: card.state for card in page.service.robot().slots}
        content = wiring_svg(topics, states)
        if drawing.content != content:
            drawing.set_content(content)
        titles = ("Topic", "Type", "From", "To", "Rate", "Samples", "Latest value")
        head = "".join(f"<th>{escape(page.say(title))}</th>" for title in titles)
        rows = "".join(
            f'<tr><td class="mono">{escape(topic.topic)}</td><td>{escape(topic.type_name)}</td>'
            f"<td>{escape(', '.join(topic.publishers))}</td><td>{escape(', '.join(topic.subscribers))}</td>"
            f'<td class="num">{topic.rate_hz:.1f} Hz</td><td class="num">{topic.count}</td>'
            f"<td>{escape(', '.join(f'{name} {value_words(value)}' for name, value in topic.fields.items()))}</td></tr>"
            for topic in topics
        )
        content = f'<table class="ms-table"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
        if table.content != content:
            table.set_content(content)

    page.every_look(show)
