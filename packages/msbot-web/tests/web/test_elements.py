"""What the server keeps of what it has given to a browser."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from nicegui import Client, ui
from nicegui.page import page as nicegui_page

from msbot_web.nicegui_internals.elements import forget_content

CARDS = "<p>" + "card " * 1000 + "</p>"


@pytest.fixture
def client() -> Iterator[Client]:
    found = Client(nicegui_page("/"), request=None)
    yield found
    found.delete()


async def test_a_text_is_kept_until_the_browser_has_it_and_can_be_given_anew(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    with client:
        element = ui.html(CARDS, sanitize=False)
    client.outbox.updates.clear()  # as when the page is made
    assert not forget_content(element)  # the browser has not come yet
    monkeypatch.setattr(Client, "has_socket_connection", True)
    element.set_content(CARDS + "!")
    assert not forget_content(element)  # it is on its way
    assert element.content == CARDS + "!"
    client.outbox.updates.clear()
    assert forget_content(element)
    assert (element.content, element._props["innerHTML"], len(client.outbox.updates)) == ("", "", 0)
    element.set_content(CARDS)
    assert element._props["innerHTML"] == CARDS
    assert element.id in client.outbox.updates
